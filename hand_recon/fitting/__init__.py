"""Fitting each hand to its 2D landmarks, with the knowledge and likelihood of training (Sec. 3.2–3.3)."""
