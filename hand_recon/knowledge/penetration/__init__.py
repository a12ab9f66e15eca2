"""Non-penetration: depth of parts of the hand inside other parts (Sec. 3.2, Eq. 4)."""
