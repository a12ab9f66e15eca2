"""DexYCB: real right and left hands that grasp things, eight cameras at a time (Sec. 4.1)."""
