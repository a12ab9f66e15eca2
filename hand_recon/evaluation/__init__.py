"""Metrics of reconstructed hands: alignment, 3D and 2D errors, plausibility, calibration (Sec. 4.1)."""
