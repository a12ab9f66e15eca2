"""Checks of fitted hands that verdicts are made of (decision 59)."""
