"""From a video to hands over time: found, followed, fitted, smoothed, drawn."""
