"""Synthetic hands written as the published datasets lie on disk: to rehearse with, and to test with."""
