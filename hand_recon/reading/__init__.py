"""Files from elsewhere, read within limits: text, JSON, YAML, arrays of NumPy, archives (decision 92)."""
