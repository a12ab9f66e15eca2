"""torch.compile for the benchmark: one graph without breaks, or the reason why there is none."""

import functools
from collections.abc import Callable
from typing import Any

import torch

from hand_recon.speed.measurement import Settings


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function as one graph; a break in the graph is an error.

    Args:
        function: The function, compiled anew for every shape of its arguments.
    """
    return torch.compile(function, fullgraph=True, dynamic=False)


def compiler_problem(settings: Settings) -> str | None:
    """Reason why torch.compile does not work on this machine; None if it does."""
    if settings.quick:
        return "quick=true"
    return _problem(settings.device)


@functools.cache
def _problem(device: str) -> str | None:
    try:
        compiled(torch.square)(torch.ones(8, device=device))
    except Exception as error:  # noqa: BLE001  # whatever the compiler lacks, such as g++
        return f"torch.compile fails: {str(error).strip().splitlines()[0][:120]}"
    return None
