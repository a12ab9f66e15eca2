"""Ground-truth hands before a camera, and predictions with known errors."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch

from hand_recon.evaluation.scores import HandPoints
from hand_recon.hand.model import HandModel
from hand_recon.protocols.benchmarks import Protocol
from hand_recon.protocols.lint.lint import Finding
from tests.support.views import known_hands


def true_hands(hand: HandModel, count: int, seed: int = 0) -> HandPoints:
    """Possible poses in any view, half a metre to a metre away, in this project's order, axes and unit."""
    torch.manual_seed(seed)
    translation = torch.tensor([0.0, 0.0, 0.7]) + torch.tensor([0.1, 0.08, 0.1]) * torch.randn(
        count, 3
    )
    with torch.no_grad():
        posed = hand.to_camera(replace(known_hands(hand, count), translation=translation))
    return HandPoints(posed.landmarks.double(), posed.vertices.double())


def noisy(points: HandPoints, metres: float) -> HandPoints:
    """Points with Gaussian noise of this standard deviation, metres, on every coordinate."""
    return changed(points, lambda some: some + metres * torch.randn_like(some))


def changed(
    points: HandPoints,
    landmarks: Callable[[torch.Tensor], torch.Tensor],
    vertices: Callable[[torch.Tensor], torch.Tensor] | None = None,
) -> HandPoints:
    """Points with a function applied to the landmarks and, by default, to the vertices."""
    surface = points.vertices
    return HandPoints(
        landmarks(points.landmarks), None if surface is None else (vertices or landmarks)(surface)
    )


def write_ground_truth(folder: Path, ground_truth: HandPoints, protocol: Protocol) -> None:
    """Write `evaluation_xyz.json` and `evaluation_verts.json` in the protocol's form."""
    folder.mkdir(parents=True, exist_ok=True)
    points = protocol.from_internal(ground_truth)
    (folder / "evaluation_xyz.json").write_text(json.dumps(points.landmarks.tolist()))
    if points.vertices is not None:
        (folder / "evaluation_verts.json").write_text(json.dumps(points.vertices.tolist()))


def mistakes(findings: tuple[Finding, ...]) -> list[str]:
    """Kinds of the findings that are more than a note."""
    return [finding.kind for finding in findings if finding.confidence != "note"]
