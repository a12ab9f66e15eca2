"""The regressor: encoders of images or landmarks, and iterative error feedback (Sec. 4.1)."""
