"""Ray casting and shaded meshes, without a display or graphics driver."""
