"""Images for people: overlays, learning curves, the paper's figures, the report of a run."""
