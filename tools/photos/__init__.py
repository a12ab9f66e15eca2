"""Parts of `tools/measure_photos.py`: sets of photographs, methods, scores and tables."""
