"""The hand: its skeleton, its surface and its anatomical axes (Sec. 3.1)."""
