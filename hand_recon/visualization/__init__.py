"""Pictures for people: overlays, curves and the report."""
