"""Datasets, crops and augmentation: image files or rendered hands to batches (Sec. 4.1)."""
