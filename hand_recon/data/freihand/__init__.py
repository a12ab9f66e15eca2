"""FreiHAND: real right hands with cameras, 3D landmarks and surfaces (Sec. 4.1)."""
