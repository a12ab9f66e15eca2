"""Pictures of the open hand with labels: the embedded dataset that needs no download."""
