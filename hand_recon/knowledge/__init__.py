"""Generic hand knowledge as differentiable losses (Sec. 3.2)."""
