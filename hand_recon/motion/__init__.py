"""Hands over time: identity, choice of minima, smoothing, and the resulting motion."""
