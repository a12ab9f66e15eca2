"""Runs as the paper's tables (Sec. 4.2-5)."""
