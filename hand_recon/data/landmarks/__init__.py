"""2D landmarks of hands from any detector or annotator: files, crops, datasets (Sec. 3.3)."""
