"""The paper's tables beside our runs (Sec. 4.2-5)."""
