"""Tolerances by precision, in one table for all tests."""

from typing import Final

import torch

TOLERANCE: Final[dict[torch.dtype, tuple[float, float]]] = {
    torch.float32: (1e-4, 1e-5),
    torch.float64: (1e-9, 1e-10),
}
"""Relative and absolute tolerance by precision: about a hundred roundings of a number near one."""

BATCH_SHAPES: Final[list[tuple[int, ...]]] = [(), (4,), (2, 3)]
"""Leading axes that every `*batch` must accept: one hand, a batch, a batch of sequences."""


def assert_close(actual: torch.Tensor, expected: torch.Tensor) -> None:
    """Fail unless two tensors agree within the tolerance of the less precise one, in the same shape."""
    rtol, atol = max(TOLERANCE[actual.dtype], TOLERANCE[expected.dtype])
    torch.testing.assert_close(actual, expected, rtol=rtol, atol=atol, check_dtype=False)
