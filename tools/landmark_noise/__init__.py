"""Measurements of σ of the detector's landmarks, for `tools/measure_landmark_noise.py`."""
