"""HO3D: real right hands that hold objects, with cameras and 3D landmarks (Sec. 4.1)."""
