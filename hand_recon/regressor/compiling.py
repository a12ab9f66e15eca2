"""torch.compile on this machine: backbones of a network, and the reason why it does not work."""

import functools
from collections.abc import Callable
from typing import Any

import torch
from torch import nn

from hand_recon.regressor.backbones import Backbone


def one_graph(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function as one graph; a break in the graph is an error.

    Args:
        function: The function, compiled anew for every shape of its arguments.
    """
    return torch.compile(function, fullgraph=True, dynamic=False)


def compile_backbones(network: nn.Module, device: str) -> int:
    """Compile the backbones of a network, at the first batch of each shape; their weights keep their names.

    Args:
        network: The network.
        device: Device that it will run on.

    Returns:
        Number of backbones.

    Raises:
        ValueError: The network has none, or torch.compile does not work here.
    """
    backbones = [module for module in network.modules() if isinstance(module, Backbone)]
    if not backbones:
        raise ValueError(
            "compile=true compiles the backbone of a network for images, and this model has none. Use "
            "compile=false."
        )
    problem = compiler_problem(device)
    if problem is not None:
        raise ValueError(
            f"compile=true does not work on this machine: {problem}. Install a C++ compiler such as g++ (and "
            "Triton for a GPU), or use compile=false."
        )
    for backbone in backbones:
        backbone.compile()
    return len(backbones)


@functools.cache
def compiler_problem(device: str) -> str | None:
    """Reason why torch.compile does not work on a device; None if it does.

    Args:
        device: Device of torch.
    """
    try:
        one_graph(torch.square)(torch.ones(8, device=device))
    except Exception as error:  # noqa: BLE001  # whatever is missing, such as g++
        lines = str(error).strip().splitlines()
        return f"torch.compile fails ({lines[0][:120] if lines else type(error).__name__})"
    return None
