"""Non-penetration: no part of the hand enters another (Sec. 3.2, Eq. 4)."""
