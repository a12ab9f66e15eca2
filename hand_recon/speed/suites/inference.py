"""Networks at work: PyTorch eager and compiled, onnxruntime, and onnxruntime with weights of eight bits."""

import logging
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor

from hand_recon import __version__
from hand_recon.formats.onnx_file import PACKAGES, VERSION_ENTRY, check_installed, to_onnx
from hand_recon.formats.onnx_graphs import CropGraph, NetworkGraph
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.compiling import compiler_problem, one_graph
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.runs.lifters import DEFAULT
from hand_recon.runs.onnx_run import load_graph
from hand_recon.speed.measurement import Settings, Work, interleaved, ratios, spread
from hand_recon.speed.rows import LeftOut, Row, hands
from hand_recon.speed.threads import measure_busy, measure_threads

BATCHES: Final = (1, 32)
ACCURATE: Final = 1e-4
"""Largest change of a vertex at which a network of eight bits is as good, metres."""
_HIDDEN: Final = re.compile(r"regressor\.(encoder|regressor)\..*weight$")
"""Names of the weights of hidden layers."""
SIZE: Final = 136
"""Side of the crops of `recipe=photos`, pixels."""


def measure(settings: Settings) -> Iterator[Row | LeftOut]:
    """Time the packaged lifter and a network for photographs; PyTorch eager is the reference."""
    yield from _of_network("packaged lifter", load_graph(DEFAULT, open_hand())[0], settings)
    if settings.checkpoint is not None:
        yield from _of_network(
            "network of ckpt", load_graph(settings.checkpoint, open_hand())[0], settings
        )
    else:
        yield from _of_network(
            "network for photographs, random weights", random_network(), settings
        )
    if settings.device == "cpu":
        yield from measure_busy(BATCHES, settings)


def random_network() -> NetworkGraph:
    """The network of `recipe=photos` with random weights: as fast as a trained one."""
    torch.manual_seed(0)
    landmarks = LandmarkEncoder(width=512, depth=2, confidence=True)
    encoder = PhotoEncoder(
        "efficientnet_lite0", "none", landmarks=landmarks, width=256, map_width=96
    )
    regressor = Regressor(encoder, open_hand(), width=512, activation=True, reprojection=True)
    return CropGraph(regressor.eval(), SIZE)


def _of_network(name: str, graph: NetworkGraph, settings: Settings) -> Iterator[Row | LeftOut]:
    forms, left_out = _forms(name, graph, settings)
    yield from left_out
    for batch in BATCHES:
        values = graph.example(batch)
        works: dict[str, Work] = {"eager": partial(_eager, graph, values)}
        works |= {form: partial(run, values) for form, run in forms.items()}
        expected = _points(graph, graph(*values))
        times = interleaved(works, settings)
        yield Row(
            suite="inference",
            work=f"{name}, PyTorch",
            size=hands(batch),
            items=batch,
            seconds=spread(times["eager"]),
        )
        for form, run in forms.items():
            difference = float((_points(graph, run(values)) - expected).abs().max())
            yield Row(
                suite="inference",
                work=f"{name}, {form}",
                size=hands(batch),
                items=batch,
                seconds=spread(times[form]),
                reference="PyTorch, eager",
                reference_seconds=spread(times["eager"]),
                ratio=ratios(times["eager"], times[form]),
                difference=f"{1e3 * difference:.1g} mm",
                note=""
                if difference <= ACCURATE
                else "differs by more than 0.1 mm: not to be used",
            )
    if settings.device == "cpu":
        yield from measure_threads(name, graph, BATCHES, settings)


def _forms(
    name: str, graph: NetworkGraph, settings: Settings
) -> tuple[dict[str, Any], list[LeftOut]]:
    """Functions from inputs to outputs, by the name of the form, and those that are missing."""
    forms: dict[str, Any] = {}
    left_out = []
    problem = "quick=true" if settings.quick else compiler_problem("cpu")
    if problem is None:
        forms["compiled"] = _Compiled(graph)
    else:
        left_out.append(LeftOut("inference", f"{name}, compiled", problem))
    try:
        check_installed()
    except ModuleNotFoundError:
        left_out.append(
            LeftOut("inference", f"{name}, onnxruntime", f"{', '.join(PACKAGES)} are missing")
        )
        return forms, left_out
    content = to_onnx(graph, {VERSION_ENTRY: __version__})
    forms["onnxruntime"] = _Session(graph, content, settings.threads)
    forms["onnxruntime, 8 bits"] = _Session(graph, eight_bits(content), settings.threads)
    return forms, left_out


class _Compiled:
    """A network as one compiled graph."""

    def __init__(self, graph: NetworkGraph) -> None:
        self.run = one_graph(graph.forward)

    @torch.no_grad()
    def __call__(self, values: Sequence[Tensor]) -> Sequence[Tensor]:
        outputs: Sequence[Tensor] = self.run(*values)
        return outputs


class _Session:
    """A network in onnxruntime, with threads that do not wait busily."""

    def __init__(self, graph: NetworkGraph, content: bytes, threads: int) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 3
        providers = ["CPUExecutionProvider"]
        self.session = onnxruntime.InferenceSession(content, options, providers=providers)
        self.inputs = graph.inputs

    def __call__(self, values: Sequence[Tensor]) -> Sequence[Tensor]:
        feeds = {name: value.numpy() for name, value in zip(self.inputs, values, strict=True)}
        return [torch.from_numpy(np.asarray(output)) for output in self.session.run(None, feeds)]


def eight_bits(content: bytes) -> bytes:
    """Quantize the hidden layers of an ONNX network to eight bits; not its convolutions, hand or outputs.

    Args:
        content: The network.
    """
    import onnx
    from onnxruntime.quantization import QuantType, quantize_dynamic

    # Convolutions that are quantized at run time are slower than those in single precision.
    hidden = [
        node.name
        for node in onnx.load_from_string(content).graph.node
        if node.op_type == "Gemm" and any(_HIDDEN.search(name) for name in node.input)
    ]
    # The quantizer splits such a node into a product and a sum first, and names the product so.
    hidden += [f"{name}_MatMul" for name in hidden]
    with tempfile.TemporaryDirectory() as folder:
        whole, small = Path(folder, "whole.onnx"), Path(folder, "small.onnx")
        whole.write_bytes(content)
        with _without_remarks():
            quantize_dynamic(
                whole,
                small,
                weight_type=QuantType.QInt8,
                nodes_to_quantize=hidden,
                per_channel=True,
            )
        return small.read_bytes()


@contextmanager
def _without_remarks() -> Iterator[None]:
    """Leave out what onnxruntime says at each tensor that stays as it is."""
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


@torch.no_grad()
def _eager(graph: NetworkGraph, values: Sequence[Tensor]) -> Sequence[Tensor]:
    outputs: Sequence[Tensor] = graph(*values)
    return outputs


def _points(graph: NetworkGraph, outputs: Sequence[Tensor]) -> Tensor:
    """Vertices among a network's outputs, metres."""
    return outputs[graph.outputs.index("vertices")].detach()
