"""Looks at what a user has, before anything is trained on it: the machine, the files, the labels."""
