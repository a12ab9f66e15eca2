"""Determinant, inverse and solution of small linear systems in closed form, for export to ONNX.

ONNX has no operator for an inverse or a linear system. Inside `closed_form()`, PyTorch's functions are
replaced by Cramer's rule, which suits the camera matrices and rotations of this project.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import torch
from jaxtyping import Float
from torch import Tensor
from torch.overrides import TorchFunctionMode


def determinant(matrix: Float[Tensor, "*batch side side"]) -> Float[Tensor, "*batch"]:
    """Determinant of matrices of 2 or 3 rows.

    Raises:
        ValueError: The matrices have another number of rows.
    """
    rows = matrix.unbind(-2)
    if matrix.shape[-1] == 2:
        return rows[0][..., 0] * rows[1][..., 1] - rows[0][..., 1] * rows[1][..., 0]
    _check_three(matrix)
    return (rows[0] * torch.linalg.cross(rows[1], rows[2])).sum(dim=-1)


def inverse(matrix: Float[Tensor, "*batch side side"]) -> Float[Tensor, "*batch side side"]:
    """Inverse of matrices of 3 rows, by cross products of the rows.

    Raises:
        ValueError: The matrices have another number of rows.
    """
    _check_three(matrix)
    first, second, third = matrix.unbind(-2)
    columns = [
        torch.linalg.cross(second, third),
        torch.linalg.cross(third, first),
        torch.linalg.cross(first, second),
    ]
    return torch.stack(columns, dim=-1) / determinant(matrix)[..., None, None]


def solution(
    matrix: Float[Tensor, "*batch 3 3"], right: Float[Tensor, "*batch 3 column"]
) -> Float[Tensor, "*batch 3 column"]:
    """Solution x of A x = b for matrices A of 3 rows."""
    return inverse(matrix) @ right


def _check_three(matrix: Tensor) -> None:
    if matrix.shape[-2:] != (3, 3):
        raise ValueError(
            f"Found a matrix of shape {tuple(matrix.shape)} in a network for ONNX; expected 3 × 3, whose "
            "inverse is written in closed form. Extend hand_recon/formats/onnx_matrices.py."
        )


_CLOSED: Final[Mapping[Callable[..., Any], Callable[..., Tensor]]] = {
    torch.linalg.det: determinant,
    torch.linalg.inv: inverse,
    torch.linalg.solve: solution,
}


class closed_form(TorchFunctionMode):  # noqa: N801  # used as a function: `with closed_form():`
    """Context in which `torch.linalg.det`, `inv` and `solve` are those of this module."""

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Iterable[type],
        args: tuple[Any, ...] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:  # noqa: ANN401  # PyTorch's interface
        """Call a function of PyTorch, or its closed form."""
        called: Callable[..., Any] = _CLOSED.get(func, func)
        return called(*args, **(kwargs or {}))
