"""Motion of hands as files of other programs: animated GLB, BVH, tables of angles."""
