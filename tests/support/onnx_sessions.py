"""A small lifter as an ONNX file, and ONNX files read by onnxruntime, which shares no code with PyTorch."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import jaxtyping
import numpy as np
import torch

from hand_recon.formats.onnx_file import to_onnx
from hand_recon.formats.onnx_graphs import LifterGraph, NetworkGraph
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.lifter_file import LifterSettings

SMALL = LifterSettings(width=16, depth=1, iterations=1, confidence=False)
"""A lifter of one round, with the inputs of the packaged one."""


@dataclass(frozen=True)
class LifterFile:
    """A lifter and its ONNX file."""

    regressor: Regressor
    content: bytes


def small_lifter_file() -> LifterFile:
    """A lifter of one round with random weights, and inputs as the packaged one has them."""
    with torch.random.fork_rng():
        torch.manual_seed(5)
        regressor = SMALL.build(open_hand("mediapipe"))
        with torch.no_grad():
            for parameter in regressor.parameters():
                parameter.add_(0.03 * torch.randn_like(parameter))
    about = {"hand_recon_version": "1.2.3", "licence": "none"}
    with unchecked_shapes():
        content = to_onnx(LifterGraph(regressor), about)
    return LifterFile(regressor, content)


@contextmanager
def unchecked_shapes() -> Iterator[None]:
    """Context without checks of shapes, which a translation makes for every number of hands at once."""
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)


def example_of(graph: NetworkGraph, hands: int) -> dict[str, torch.Tensor]:
    """Inputs by name.

    Args:
        graph: The network.
        hands: Number of hands.
    """
    return dict(zip(graph.inputs, graph.example(hands), strict=True))


def session_of(content: bytes) -> Any:  # noqa: ANN401  # onnxruntime has no types
    """A session with one thread.

    Args:
        content: Contents of the file.
    """
    # Not at the top: tests skip without the extra.
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def outputs_of(session: Any, inputs: dict[str, torch.Tensor]) -> dict[str, np.ndarray]:  # noqa: ANN401
    """All outputs by name.

    Args:
        session: The network, of `session_of`.
        inputs: Its inputs by name.
    """
    names = [output.name for output in session.get_outputs()]
    feeds = {name: value.numpy() for name, value in inputs.items()}
    return dict(zip(names, session.run(names, feeds), strict=True))


def shapes_of(session: Any) -> dict[str, list[int | str]]:  # noqa: ANN401
    """Declared shapes of all inputs and outputs, names for free axes.

    Args:
        session: The network, of `session_of`.
    """
    return {value.name: value.shape for value in [*session.get_inputs(), *session.get_outputs()]}
