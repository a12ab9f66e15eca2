"""Runs side by side: the paper's tables beside ours, over seeds and with intervals."""
