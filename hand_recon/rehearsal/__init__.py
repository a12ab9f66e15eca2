"""Writers of synthetic hands in the file layouts of FreiHAND, DexYCB and HO3D, to test their loaders."""
