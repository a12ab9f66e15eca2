"""Checks of a file of predictions for mistakes in order, unit, axes, side and sequence."""
