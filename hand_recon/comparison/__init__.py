"""Runs side by side: the paper's Table 1 beside ours, over seeds and with intervals."""
