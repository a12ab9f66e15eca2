"""The value of a term and its gradient."""

from torch import Tensor, nn


def value_and_gradient(term: nn.Module, vertices: Tensor) -> tuple[Tensor, Tensor]:
    """Loss of each hand, and the gradient of their sum by the vertices."""
    moved = vertices.detach().clone().requires_grad_()
    value = term(moved)
    value.sum().backward()
    assert moved.grad is not None
    return value.detach(), moved.grad
