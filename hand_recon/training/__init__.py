"""The LightningModule, learning-rate schedules, and 3D supervision for comparison (Sec. 3.4)."""
