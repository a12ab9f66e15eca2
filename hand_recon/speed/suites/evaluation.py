"""Scores of the benchmarks' test sets, from the files of predictions to the printed scores (Sec. 4.1)."""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from typing import Final

import numpy as np
import torch

from hand_recon.evaluation.scores import HandPoints
from hand_recon.hand.open_hand import open_hand
from hand_recon.protocols.benchmarks import PROTOCOLS, Protocol
from hand_recon.protocols.official import freihand_scores
from hand_recon.speed.measurement import Settings, Work, interleaved, ratios, spread
from hand_recon.speed.published import scores_by_definition
from hand_recon.speed.rows import Row

COMPARED: Final = 64
"""Hands of the comparison with the script, which takes minutes for all."""
DISTINCT: Final = 512
"""Different hands in the files; the others repeat them."""
MESH: Final = 778
RUNS: Final = 3


@dataclass(frozen=True)
class ScoredSet:
    """A benchmark's test set, and what is aimed at."""

    protocol: Protocol
    """The benchmark."""
    frames: int
    """Number of its hands."""
    wanted_seconds: float
    """Most processor time, seconds."""


FREIHAND: Final = ScoredSet(PROTOCOLS["freihand"], 3960, 5.0)
HO3D: Final = ScoredSet(PROTOCOLS["ho3d_v3"], 20137, 30.0)


_LAUNCHER: Final = """
import os, sys
process = os.posix_spawn(sys.argv[2], sys.argv[2:], os.environ)
_, status, usage = os.wait4(process, 0)
with open(sys.argv[1], "w") as file:
    file.write(f"{usage.ru_utime + usage.ru_stime} {usage.ru_maxrss}")
sys.exit(os.waitstatus_to_exitcode(status))
"""
"""Small program that starts a command: at its start, a process counts its parent's memory as its own."""


def measure(settings: Settings) -> Iterator[Row]:
    """Compare the scores with the script's structure, then time the command on files of a test set."""
    yield _compared(settings)
    yield _command(FREIHAND, settings, 1 if settings.quick else RUNS)
    if not settings.quick:
        yield _command(HO3D, settings, 1)


def _compared(settings: Settings) -> Row:
    ground_truth, prediction = posed_hands(COMPARED)
    works: dict[str, Work] = {
        "ours": partial(freihand_scores, ground_truth, prediction),
        "script": partial(
            scores_by_definition.freihand_scores, *map(_arrays, (ground_truth, prediction))
        ),
    }
    found, expected = freihand_scores(ground_truth, prediction), works["script"]()
    assert isinstance(expected, dict)  # noqa: S101  # by its definition
    # Centimetres; shares are compared as if they were.
    difference = 10 * max(abs(found[name] - expected[name]) for name in expected)
    times = interleaved(works, settings)
    return Row(
        suite="evaluation",
        work="FreiHAND's scores with meshes",
        size=f"{COMPARED} hands",
        items=COMPARED,
        seconds=spread(times["ours"]),
        reference="frame by frame with SciPy, as the official script",
        reference_seconds=spread(times["script"]),
        ratio=ratios(times["script"], times["ours"]),
        difference=f"{difference:.1g} mm",
    )


def _command(test_set: ScoredSet, settings: Settings, runs: int) -> Row:
    name = test_set.protocol.name
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_files(folder, test_set)
        words = [f"protocol={name}", f"ground_truth={folder}", f"threads={settings.threads}"]
        command = [sys.executable, "-m", "hand_recon", "score", str(folder / "pred.json"), *words]
        found = [
            _run([*command, f"hydra.run.dir={folder / str(number)}"], settings)
            for number in range(runs)
        ]
    return Row(
        suite="evaluation",
        work=f"hand-recon score protocol={name}, from files to printed scores",
        size=f"{test_set.frames} hands",
        items=test_set.frames,
        seconds=spread([seconds for seconds, _ in found]),
        wanted_seconds=test_set.wanted_seconds,
        megabytes=max(memory for _, memory in found),
        note="a process of its own, start of Python included",
    )


def _run(command: Sequence[str], settings: Settings) -> tuple[float, float]:
    """Seconds and megabytes of a command.

    Raises:
        RuntimeError: It failed.
    """
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        usage = Path(folder, "usage")
        words = [sys.executable, "-S", "-c", _LAUNCHER, str(usage), *command]
        process = subprocess.run(words, capture_output=True, check=False)  # noqa: S603  # our own words
        wall = time.perf_counter() - began
        if process.returncode:
            said = (process.stdout + process.stderr).decode(errors="replace")[-2000:]
            raise RuntimeError(f"{' '.join(command)} failed, expected were scores: {said}")
        processor, kilobytes = map(float, usage.read_text(encoding="ascii").split())
    return processor if settings.processor_time else wall, kilobytes / 1024


def write_files(folder: Path, test_set: ScoredSet) -> None:
    """Write predictions and ground truth of a test set in the benchmark's format.

    Args:
        folder: Where `pred.json`, `evaluation_xyz.json` and `evaluation_verts.json` are written.
        test_set: Their number and format. The ground truth has all digits, as FreiHAND's.
    """
    hands = map(test_set.protocol.from_internal, posed_hands(min(DISTINCT, test_set.frames)))
    ground_truth, prediction = (_arrays(some) for some in hands)
    decimals = test_set.protocol.decimals
    predicted = {name: points.round(decimals) for name, points in prediction.items()}
    for name, points in {"xyz": ground_truth["xyz"], "verts": ground_truth["mesh"]}.items():
        with (folder / f"evaluation_{name}.json").open("x") as stream:
            stream.writelines(_texts(points, test_set.frames))
    with (folder / "pred.json").open("x") as stream:
        stream.write("[")
        stream.writelines(_texts(predicted["xyz"], test_set.frames))
        stream.write(", ")
        stream.writelines(_texts(predicted["mesh"], test_set.frames))
        stream.write("]")


def _texts(points: np.ndarray, count: int) -> Iterator[str]:
    """A JSON list of frames, in pieces."""
    texts = [json.dumps(frame.tolist()) for frame in points]
    for number, text in enumerate(islice(cycle(texts), count)):
        yield ("[" if number == 0 else ", ") + text
    yield "]"


def posed_hands(
    count: int, *, angle_error: float = 0.2, seed: int = 0
) -> tuple[HandPoints, HandPoints]:
    """Open hands in random poses, and predictions with errors of joint angles and translation.

    Args:
        count: Number of hands.
        angle_error: Standard deviation of the bend's error, radians; those of splay and twist are smaller.
        seed: Seed of poses and errors.
    """
    generator = torch.Generator().manual_seed(seed)
    hand = open_hand()

    def posed(angles: torch.Tensor, translation: torch.Tensor) -> HandPoints:
        geometry = hand(angles, torch.zeros(count, 10))
        # As many vertices as MANO has.
        vertices = geometry.vertices[:, :MESH]
        return HandPoints(geometry.landmarks + translation, vertices + translation)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(count, *shape, generator=generator)

    axes = torch.tensor([1.0, 0.3, 0.1])
    angles = 0.3 * random(15, 3) * axes
    translation = torch.tensor([0.0, 0.0, 0.6])
    ground_truth = posed(angles, translation)
    return ground_truth, posed(
        angles + angle_error * random(15, 3) * axes, translation + 0.02 * random(1, 3)
    )


def _arrays(points: HandPoints) -> dict[str, np.ndarray]:
    assert points.vertices is not None  # noqa: S101  # posed hands have a surface
    return {"xyz": points.landmarks.double().numpy(), "mesh": points.vertices.double().numpy()}
