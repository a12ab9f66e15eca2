"""From files, or from nothing, to batches of hands: crops, augmentation, datasets (Sec. 4.1)."""
