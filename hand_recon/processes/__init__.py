"""Processes that train and test together: what they exchange (decision 94)."""
