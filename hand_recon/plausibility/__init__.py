"""Plausibility of hand poses of any origin: ranges, functional anatomy, penetration, bones, jitter."""
