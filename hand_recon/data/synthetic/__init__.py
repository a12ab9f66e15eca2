"""Synthetic dataset: labelled images of the open hand, rendered locally without a download."""
