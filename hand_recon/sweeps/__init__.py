"""Sweeps and searches: many runs, each in a process of its own (decision 95)."""
