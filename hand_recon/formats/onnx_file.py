"""A network as one ONNX file that describes itself, compared with PyTorch before it is written."""

import contextlib
import importlib.util
import json
import logging
import warnings
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
import torch

from hand_recon.formats.onnx_graphs import INPUTS, OUTPUTS, NetworkGraph
from hand_recon.formats.onnx_matrices import closed_form
from hand_recon.hand.skeleton import ARTICULATED, LANDMARKS
from hand_recon.regressor.lifter_file import fingerprint

if TYPE_CHECKING:
    import onnx
    import onnx_ir

OPSET: Final = 20
"""Version of ONNX's operators; onnxruntime reads it from 1.17 on."""

FILE_VERSION: Final = 9
"""Version of ONNX's file format, the newest that onnxruntime 1.17 reads."""

BATCH: Final = "batch"
"""Name of the axis of hands."""

WITHOUT_BATCH: Final = ("faces",)
"""Outputs that are the same for all hands."""

LARGEST_DIFFERENCE: Final = 1e-4
"""Largest difference of landmarks and vertices between onnxruntime and PyTorch, metres."""

VERSION_ENTRY: Final = "hand_recon_version"
"""Name of the metadata that has the version of hand_recon."""

PACKAGES: Final = ("onnx", "onnxscript", "onnxruntime")
"""Packages of the extra `onnx`."""


def to_onnx(graph: NetworkGraph, about: Mapping[str, str]) -> bytes:
    """Convert a network, check it, and compare it with PyTorch in onnxruntime.

    Args:
        graph: The network.
        about: Further entries of the file's metadata: `VERSION_ENTRY`, and such as the checkpoint's digest.

    Returns:
        Contents of the file.

    Raises:
        ModuleNotFoundError: The extra `onnx` is not installed.
        ValueError: onnxruntime gives other numbers than PyTorch.
    """
    check_installed()
    model = _translated(graph)
    _describe(model, graph, about)
    content: bytes = model.SerializeToString()
    _check(content)
    check_agreement(graph, content)
    return content


def check_agreement(graph: NetworkGraph, content: bytes) -> None:
    """Compare an ONNX network with PyTorch's.

    Args:
        graph: The network.
        content: Its ONNX file.

    Raises:
        ValueError: They differ by more than `LARGEST_DIFFERENCE`.
    """
    difference = largest_difference(graph, content)
    if not difference <= LARGEST_DIFFERENCE:
        raise ValueError(
            f"The ONNX network differs from PyTorch's by {difference:.2g} m; expected at most "
            f"{LARGEST_DIFFERENCE:g} m. Nothing is written: install the locked versions of onnx, onnxscript "
            "and onnxruntime (`make env`), and report it with the checkpoint."
        )


def check_installed() -> None:
    """Check that the extra `onnx` is installed.

    Raises:
        ModuleNotFoundError: One of its packages is not.
    """
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise ModuleNotFoundError(
            f"format=onnx needs {', '.join(missing)}, which is not installed. Install the extra: pip install "
            "'hand_recon[onnx]', or in a checkout `make env`."
        )


@torch.no_grad()
def largest_difference(graph: NetworkGraph, content: bytes) -> float:
    """Largest difference of landmarks and vertices between onnxruntime and PyTorch, metres.

    Args:
        graph: The network.
        content: Its ONNX file.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    largest = 0.0
    # One hand, and a number of hands that was not traced.
    for hands in (1, 3):
        values = graph.example(hands)
        feeds = {name: value.numpy() for name, value in zip(graph.inputs, values, strict=True)}
        expected = dict(zip(graph.outputs, graph(*values), strict=True))
        names = ["landmarks_3d", "vertices"]
        for name, found in zip(names, session.run(names, feeds), strict=True):
            # NaN where PyTorch has none is a difference, too, and a missing axis an error.
            difference = np.abs(found - expected[name].numpy()).max()
            largest = max(largest, float(np.nan_to_num(difference, nan=np.inf)))
    return largest


@torch.no_grad()
def _translated(graph: NetworkGraph) -> "onnx.ModelProto":
    """ONNX's form of a network, with a free number of hands."""
    # Two hands: with one, the exporter takes the number for a constant.
    values = graph.example(2)
    with closed_form(), _quiet():
        program = torch.onnx.export(
            graph,
            values,
            dynamo=True,
            opset_version=OPSET,
            dynamic_shapes=({0: BATCH},) * len(values),
            input_names=list(graph.inputs),
            output_names=list(graph.outputs),
            external_data=False,
            verbose=False,
            # Several times slower than what follows, for an eighth fewer nodes.
            optimize=False,
        )
        if program is None:
            raise AssertionError
        _shorten(program.model)
    # The exporter names some values inside by their variables, which can be the name of an output.
    outputs = {id(value) for value in program.model.graph.outputs}
    for value in (value for node in program.model.graph for value in node.outputs):
        if value.name in graph.outputs and id(value) not in outputs:
            value.name = f"{value.name}_inside"
    proto = program.model_proto
    proto.ir_version = FILE_VERSION
    _remove_traces(proto)
    return proto


def _remove_traces(model: "onnx.ModelProto") -> None:
    """Remove the exporter's notes on each operator, in place.

    They have lines of source code with the paths of this machine, and are a seventh of a lifter's file.
    """
    graph = model.graph
    values = (*graph.input, *graph.output, *graph.value_info, *graph.initializer)
    for noted in (graph, *graph.node, *values):
        del noted.metadata_props[:]


def _shorten(model: "onnx_ir.Model") -> None:
    """Remove what is constant, unused or repeated from a model, in place."""
    from onnx_ir.passes.common import CommonSubexpressionEliminationPass
    from onnxscript import optimizer

    described = [(value.type, value.shape) for value in model.graph.outputs]
    optimizer.fold_constants(model)
    optimizer.remove_unused_nodes(model)
    CommonSubexpressionEliminationPass()(model)
    # An output that repeats another value is made anew, without type and shape.
    for value, (kind, shape) in zip(model.graph.outputs, described, strict=True):
        value.type, value.shape = kind, shape


def _describe(model: "onnx.ModelProto", graph: NetworkGraph, about: Mapping[str, str]) -> None:
    """Write what a network is into its file: producer, units of each tensor, and metadata."""
    model.producer_name, model.producer_version = "hand_recon", about[VERSION_ENTRY]
    model.doc_string = "3D hands with σ; inputs, outputs and units: docs/onnx.md of hand_recon."
    for values, texts in ((model.graph.input, INPUTS), (model.graph.output, OUTPUTS)):
        for value in values:
            value.doc_string = texts[value.name]
    for key, text in (_metadata(graph) | dict(about)).items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, text


def _metadata(graph: NetworkGraph) -> dict[str, str]:
    hand = graph.regressor.hand
    units = {name: INPUTS[name] for name in graph.inputs}
    units |= {name: OUTPUTS[name] for name in graph.outputs}
    return {
        "network": graph.kind,
        "hand_model": fingerprint(hand),
        "landmark_set": hand.landmark_set,
        "landmark_order": json.dumps(list(LANDMARKS)),
        "joint_order": json.dumps(list(ARTICULATED)),
        "side": "right; left hands are mirrored before and after",
        "units": json.dumps(units, ensure_ascii=False),
    }


def _check(content: bytes) -> None:
    """Check a model by ONNX's own rules, shapes and types included."""
    import onnx

    onnx.checker.check_model(content, full_check=True)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Context without the exporter's remarks that say nothing about this network."""
    remarks = [logging.getLogger(name) for name in ("onnx_ir", "onnxscript")]
    before = [logger.level for logger in remarks]
    for logger in remarks:
        logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            # All inputs share one axis of hands, which has one name.
            warnings.filterwarnings("ignore", message=".*The axis name: batch will not be used")
            yield
    finally:
        for logger, level in zip(remarks, before, strict=True):
            logger.setLevel(level)
