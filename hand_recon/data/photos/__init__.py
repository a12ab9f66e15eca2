"""Photographs as people have them: formats, EXIF, colours, folders of them."""
