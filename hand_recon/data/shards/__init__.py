"""Images and 2D landmarks in tar files, local or behind a URL, for data beyond one disk (decision 98)."""
