"""The LightningModule, 3D supervision to compare with, and learning-rate schedules (Sec. 3.4)."""
