"""DexYCB: real right and left hands that grasp objects, seen by eight cameras (Sec. 4.1)."""
