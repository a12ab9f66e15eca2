"""Measurement of motion: clips with ground truth, their fits frame by frame, scores and tables."""
