"""Launchers for Hydra, which looks for them in packages of this name (decision 95)."""
