"""Scoring of prediction files as the benchmarks do it, with a lint for common mistakes (Sec. 4.1)."""

import json
import logging
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from jaxtyping import Float, Int
from rich.console import Console
from torch import Tensor

from hand_recon.evaluation.scores import LANDMARK_SCORES, HandPoints, landmark_scores
from hand_recon.protocols.benchmarks import Protocol, protocol_named, report_scores
from hand_recon.protocols.lint.frames import read_frame_names
from hand_recon.protocols.lint.lint import Finding, closing_line, lint
from hand_recon.protocols.prediction_files import Pair, read_pair
from hand_recon.protocols.submission import write_submission

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Request:
    """Predictions to be scored, and their ground truth."""

    predictions: Path
    """`pred.json`, a zip of it, or DexYCB's text."""
    protocol: Protocol
    """Benchmark whose format the files have and whose scores are computed."""
    ground_truth: Path
    """Folder with `evaluation_xyz.json` and, where known, `evaluation_verts.json`."""
    outputs: tuple[Path, ...]
    """JSON files to write the scores to; none of them may exist."""


def score_predictions(request: Request) -> dict[str, Any]:
    """Read a file of predictions, score and lint it, print and write the result.

    Returns:
        The official script's scores by its names; number of `frames`, `remarks` on the files, and the
        findings of the `lint`.

    Raises:
        FileExistsError: An output exists already.
        FileNotFoundError: A file does not exist.
        ValueError: A file has another format, or the two do not have the same frames.
    """
    # Before reading, which may take a minute.
    for path in request.outputs:
        if path.exists():
            raise FileExistsError(f"{path} exists and is not overwritten; name another output.")
    protocol = request.protocol
    pair = read_pair(request.predictions, request.ground_truth, protocol)
    ground_truth, prediction = (
        protocol.to_internal(pair.ground_truth),
        protocol.to_internal(pair.prediction),
    )
    official = protocol.scores(ground_truth, prediction)
    findings = lint(
        pair.ground_truth,
        pair.prediction,
        protocol,
        pair.predicted_vertices,
        read_frame_names(request.ground_truth, len(ground_truth)),
    )
    _print(official, _in_papers_names(official, ground_truth, prediction), pair, findings)
    result = {
        **official,
        "frames": len(ground_truth),
        "remarks": list(pair.remarks),
        "lint": [asdict(finding) for finding in findings],
    }
    for path in request.outputs:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as stream:
            stream.write(json.dumps(result, indent=2) + "\n")
    return result


def submit(
    protocol: str,
    landmarks: Float[Tensor, "hand landmark=21 3"],
    vertices: Float[Tensor, "hand vertex 3"] | None,
    folder: Path,
    *,
    root: Float[Tensor, "hand 3"] | None = None,
    ids: Int[Tensor, " hand"] | None = None,
) -> list[Path]:
    """Write a test set's predictions in the format of the benchmark's server.

    Args:
        protocol: Name of the benchmark.
        landmarks: FreiHAND's order, camera frame, metres; left hands mirrored back.
        vertices: Camera frame, metres; none where the hand model has another mesh than the benchmark's.
        folder: Folder to write into.
        root: Known position of each wrist, camera frame, metres: HO3D gives it.
        ids: DexYCB's id of each hand; none counts from zero.

    Returns:
        Paths of the written files.

    Raises:
        FileExistsError: One of the files exists already.
        ValueError: The protocol is unknown, or a prediction is not finite.
    """
    points = HandPoints(landmarks, vertices)
    paths = write_submission(protocol_named(protocol), points, folder, root=root, ids=ids)
    logger.info("Wrote %s", ", ".join(str(path) for path in paths))
    return paths


def _in_papers_names(
    official: dict[str, Any], ground_truth: HandPoints, prediction: HandPoints
) -> dict[str, float]:
    rows = landmark_scores(ground_truth, prediction).mean(dim=0).tolist()
    scores = dict(zip(LANDMARK_SCORES, rows, strict=True))
    unaligned = 1000 * scores["E_J_unaligned"], 1000 * scores["MPJPE"]
    return report_scores(official, 1000 * scores["E_J_proper"], unaligned)


def print_scores(official: dict[str, Any]) -> None:
    """Print scores under the official script's names."""
    Console(soft_wrap=True).print("\n".join(_lines(official)), markup=False, highlight=False)


def _lines(official: dict[str, Any]) -> list[str]:
    lines = ["Official scores"]
    for name, value in official.items():
        if isinstance(value, dict):
            entries = ", ".join(f"{key} {number:.4f}" for key, number in value.items())
            lines.append(f"  {name}: {entries}")
        else:
            lines.append(f"  {name}: {value:.6f}")
    return lines


def _print(
    official: dict[str, Any],
    in_papers_names: dict[str, float],
    pair: Pair,
    findings: tuple[Finding, ...],
) -> None:
    lines = _lines(official)
    lines.append("In the paper's names, errors in mm")
    lines += [f"  {name}: {value:.3f}" for name, value in in_papers_names.items()]
    lines += [f"Remark: {remark}" for remark in pair.remarks]
    for finding in findings:
        kind = "Note" if finding.confidence == "note" else f"Mistake ({finding.confidence})"
        lines.append(f"{kind}: {finding.message}")
    closing = closing_line(findings)
    lines += [] if closing is None else [closing]
    Console(soft_wrap=True).print("\n".join(lines), markup=False, highlight=False)
