"""Fits of hands to 2D landmarks, with the prior and the likelihood of training (Sec. 3.2–3.3)."""
