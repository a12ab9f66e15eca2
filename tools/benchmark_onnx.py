"""Benchmark of networks in onnxruntime and in PyTorch: processor time of one thread.

    python -m tools.benchmark_onnx                       # the packaged lifter
    python -m tools.benchmark_onnx default <run> …       # and the network of a run

Both get the same inputs in turn in one process, so that a busy machine slows both alike. Numbers in
docs/onnx.md are from here.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import torch

from hand_recon.formats.onnx_file import largest_difference, to_onnx
from hand_recon.formats.onnx_graphs import NetworkGraph
from hand_recon.hand.open_hand import open_hand
from hand_recon.runs.onnx_run import load_graph


def main() -> None:
    """Translate each network, and time it in both."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("networks", nargs="*", default=["default"])
    parser.add_argument("--hands", type=int, nargs="*", default=[1, 64])
    parser.add_argument("--repeats", type=int, default=200)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    print(
        "network      MB    hands  onnxruntime, ms  PyTorch, ms   ratio  repeats  largest difference, m"
    )
    for name in arguments.networks:
        graph, about = load_graph(name, open_hand())
        content = to_onnx(graph, about)
        session, difference = session_of(content), largest_difference(graph, content)
        for hands in arguments.hands:
            repeats = max(10, arguments.repeats // hands)
            ours, eager = medians(graph, session, hands, repeats)
            print(
                f"{graph.kind:10s} {len(content) / 1e6:5.1f} {hands:7d} {1e3 * ours:16.2f} "
                f"{1e3 * eager:12.2f} {eager / ours:7.2f} {repeats:8d}  {difference:.1e}"
            )
    print(f"load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


def session_of(content: bytes) -> Any:  # noqa: ANN401  # onnxruntime has no types
    """A session of onnxruntime with one thread that does not wait busily."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


@torch.no_grad()
def medians(
    graph: NetworkGraph,
    session: Any,  # noqa: ANN401  # onnxruntime has no types
    hands: int,
    repeats: int,
) -> tuple[float, float]:
    """Median processor time of onnxruntime and of PyTorch, in alternation, seconds.

    Args:
        graph: The network.
        session: The same network in onnxruntime.
        hands: Number of hands.
        repeats: Number of runs of each.
    """
    values = graph.example(hands)
    feeds = {name: value.numpy() for name, value in zip(graph.inputs, values, strict=True)}
    runs: tuple[Callable[[], Any], ...] = (
        lambda: session.run(None, feeds),
        lambda: graph(*values),
    )
    taken: tuple[list[float], list[float]] = ([], [])
    for _ in range(repeats + 3):
        for run, times in zip(runs, taken, strict=True):
            began = time.process_time()
            run()
            times.append(time.process_time() - began)
    # The first runs allocate memory.
    ours, eager = (statistics.median(times[3:]) for times in taken)
    return ours, eager


if __name__ == "__main__":
    main()
