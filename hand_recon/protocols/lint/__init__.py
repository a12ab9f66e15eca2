"""Lint of prediction files: wrong landmark order, unit, axes, side and frame order."""
