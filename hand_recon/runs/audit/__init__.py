"""Audit of hand poses: readers of files of any origin, and the command's run."""
