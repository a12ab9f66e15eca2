"""Rendered hands in the layouts of FreiHAND, DexYCB and HO3D, to rehearse their loaders without the data."""
