"""Second-order fit of hands to 2D landmarks: Levenberg–Marquardt on the training's loss (Sec. 3.4)."""
