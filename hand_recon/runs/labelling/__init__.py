"""Labels of photographs by the detector, for training (`hand-recon prepare labels`)."""
