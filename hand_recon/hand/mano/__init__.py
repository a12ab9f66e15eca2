"""The MANO hand: its files, read without running anything in them, and its layer (Sec. 3.1)."""
