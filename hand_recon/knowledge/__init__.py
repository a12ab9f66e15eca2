"""The knowledge-encoded prior: generic hand knowledge as differentiable losses (Sec. 3.2)."""
