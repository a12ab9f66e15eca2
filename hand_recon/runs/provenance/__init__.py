"""Provenance of a run: code, packages, data and machine that its numbers may depend on (decision 96)."""
