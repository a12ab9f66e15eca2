"""Convolutions in bfloat16, and compiled if wanted; all else stays in single precision.

Landmarks are moved by matrix products on the way (`PhotoEncoder`), and bfloat16 would round 200 pixels to
whole ones. So mixed precision is not around the network but around its backbone and its maps.
"""

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor, nn


def run_in_bfloat16(convolutions: nn.Module, *, compiled: bool = False) -> None:
    """Run a module in bfloat16 from now on, with results in single precision.

    Args:
        convolutions: The module, on its device; its weights keep their precision.
        compiled: Whether to compile it for training; if that fails, it runs as it is, with a note.
    """
    plain = convolutions.forward
    fast = _compiled(plain) if compiled else plain

    def forward(*inputs: Any) -> Any:  # noqa: ANN401  # those of the module
        device = next(convolutions.parameters()).device.type
        with torch.autocast(device, torch.bfloat16):
            found = fast(*inputs) if convolutions.training else plain(*inputs)
        return _in_single_precision(found)

    convolutions.forward = forward


def _compiled(plain: Callable[..., Any]) -> Callable[..., Any]:
    """A compiled function that becomes the plain one when the compiler fails."""
    compiled = torch.compile(plain, dynamic=False)
    failed = False

    def run(*inputs: Any) -> Any:  # noqa: ANN401  # those of the function
        nonlocal failed
        if not failed:
            try:
                return compiled(*inputs)
            except Exception as error:  # noqa: BLE001  # Compilers fail in many ways.
                failed = True
                print(f"Not compiled: {type(error).__name__}: {str(error)[:200]}", flush=True)
        return plain(*inputs)

    return run


def _in_single_precision(found: Any) -> Any:  # noqa: ANN401  # a tensor, a tuple or a mapping of tensors
    if isinstance(found, Tensor):
        return found.float()
    if isinstance(found, Mapping):
        return {name: value.float() for name, value in found.items()}
    return tuple(value.float() for value in found)
