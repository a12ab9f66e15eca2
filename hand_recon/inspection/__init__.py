"""Checks before a training: the machine, the files and the labels."""
