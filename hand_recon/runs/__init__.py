"""Runs: configuration, checkpoints, resuming, results and progress."""
