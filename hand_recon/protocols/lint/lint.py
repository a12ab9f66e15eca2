"""What is wrong with a file of predictions: another order, unit, axes, side or sequence of frames.

The benchmarks' alignment allows every rotation, scale and reflection, and so hides half of these
mistakes; the others cost tens of millimetres that look like a bad method. Every hypothesis is scored, and
told only where it explains the file so much better that chance cannot have done it: a bad method is not a
mistake.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.evaluation.scores import LANDMARK_SCORES, HandPoints, landmark_scores
from hand_recon.protocols.benchmarks import Protocol
from hand_recon.protocols.lint.evidence import Confidence, Hands, Suspicion, sizes, spread_evenly
from hand_recon.protocols.lint.order import repeated_frames, wrong_frames, wrong_order
from hand_recon.protocols.lint.placement import (
    constant_note,
    flat,
    root_relative_note,
    some_mirrored,
    wrong_axes,
    wrong_unit,
)
from hand_recon.protocols.lint.surface import apart, without_correspondence

MOST: Final = 500
"""Frames that are looked at, evenly spread."""

SURFACES: Final = 64
"""Meshes that are looked at."""

POINT: Final = 1e-9
"""Metres: a hand that is smaller is a point."""


@dataclass(frozen=True)
class Finding:
    """Something about a file that its author should know."""

    kind: str
    """`order`, `unit`, `axes`, `mirrored`, `some_mirrored`, `position`, `frame_order`, `repeated`, `pixels`,
    `joints_and_vertices`, `vertex_order`; and the notes `root_relative`, `scale`, `constant`,
    `unrelated`, `no_extent`."""
    message: str
    """What it looks like, and what to do."""
    score_now: float
    """The score that shows it, millimetres."""
    score_if_mended: float | None
    """The same with this and every other finding mended; none where the file cannot tell."""
    confidence: Confidence
    """`certain` or `likely` of a mistake; `note` where there is none."""

    @property
    def gain(self) -> float:
        """How much the score would fall, millimetres."""
        return 0.0 if self.score_if_mended is None else self.score_now - self.score_if_mended


def lint(
    ground_truth: HandPoints, prediction: HandPoints, protocol: Protocol, mesh: Tensor | None = None
) -> tuple[Finding, ...]:
    """Look for mistakes in predictions of at least one frame.

    Args:
        ground_truth: Ground truth in the protocol's own form.
        prediction: As the file has it, in what should be that form; finite.
        protocol: Whose form.
        mesh: The file's vertices, also where there are no true ones: frames × vertices × 3.

    Returns:
        Mistakes, the costliest first, then notes; none for a file without mistakes, however bad it is.
    """
    all_ground_truth, all_hands = (
        protocol.to_internal(HandPoints(points.landmarks)).double().landmarks
        for points in (ground_truth, prediction)
    )
    place = spread_evenly(len(all_ground_truth), MOST)
    hands = Hands(all_ground_truth[place], all_hands[place])
    if float(sizes(hands.prediction).median()) < POINT:
        found = "Most of your predictions are a single point, which no alignment can enlarge"
        return _scored([Suspicion("no_extent", found, confidence="note")], hands, hands)
    pixels = flat(hands)
    if pixels is not None:
        return _scored([pixels], hands, hands)
    mended, suspicions = _mended(hands, all_ground_truth, protocol)
    repeated = None if is_one_hand(suspicions) else repeated_frames(all_ground_truth, all_hands)
    found_in_mesh = _of_the_mesh(hands, mended, (ground_truth, prediction, mesh), protocol)
    suspicions += [some for some in (repeated, *found_in_mesh) if some is not None]
    return _scored(suspicions, hands, mended)


def is_one_hand(suspicions: list[Suspicion]) -> bool:
    """Whether it has been said that all predictions are alike."""
    return any(suspicion.kind == "constant" for suspicion in suspicions)


def _mended(
    hands: Hands, all_ground_truth: Float[Tensor, "frame landmark=21 3"], protocol: Protocol
) -> tuple[Hands, list[Suspicion]]:
    """Mend one thing after the other, the form before its place."""
    suspicions: list[Suspicion | None] = [constant_note(hands)]
    steps: list[Callable[[Hands], tuple[Hands, Suspicion | None]]] = [
        lambda some: wrong_unit(some, protocol),
        lambda some: wrong_order(some, protocol),
        lambda some: wrong_frames(some, all_ground_truth),
        lambda some: wrong_axes(some, protocol),
        some_mirrored,
    ]
    for step in steps:
        hands, suspicion = step(hands)
        suspicions.append(suspicion)
    suspicions.append(root_relative_note(hands))
    return hands, [suspicion for suspicion in suspicions if suspicion is not None]


def _of_the_mesh(
    hands: Hands,
    mended: Hands,
    points: tuple[HandPoints, HandPoints, Tensor | None],
    protocol: Protocol,
) -> list[Suspicion | None]:
    ground_truth, prediction, mesh = points
    if mesh is None:
        mesh = prediction.vertices
    if mesh is None:
        return []
    place = spread_evenly(len(mesh), MOST)
    few = spread_evenly(len(place), SURFACES)
    surface = _internal(mesh[place[few]], hands.prediction[few], protocol)
    apart_from = apart(hands.prediction[few], surface)
    # Only frames that are where they should be can be compared.
    if (
        ground_truth.vertices is None
        or ground_truth.vertices.shape[1] != mesh.shape[1]
        or apart_from is not None
    ):
        return [apart_from]
    if len(mended.ground_truth) != len(hands.ground_truth) or not torch.equal(
        mended.ground_truth, hands.ground_truth
    ):
        return [apart_from]
    true_surface = _internal(ground_truth.vertices[place[few]], hands.ground_truth[few], protocol)
    some = Hands(mended.ground_truth[few], mended.prediction[few])
    return [apart_from, without_correspondence(some, true_surface, surface)]


def _internal(surface: Tensor, landmarks: Tensor, protocol: Protocol) -> Tensor:
    vertices = protocol.to_internal(HandPoints(landmarks, surface.double())).vertices
    return surface if vertices is None else vertices


def _scored(suspicions: list[Suspicion], now: Hands, mended: Hands) -> tuple[Finding, ...]:
    before, after = _scores(now), _scores(mended)
    several = sum(suspicion.cure is not None for suspicion in suspicions) > 1
    findings = []
    for suspicion in suspicions:
        measured = suspicion.measured
        if measured is None:
            cured = None if suspicion.cure is None else after[suspicion.score]
            measured = before[suspicion.score], cured
        message = _message(suspicion, measured, several)
        findings.append(Finding(suspicion.kind, message, *measured, suspicion.confidence))
    return tuple(
        sorted(findings, key=lambda finding: (finding.confidence == "note", -finding.gain))
    )


def _message(suspicion: Suspicion, measured: tuple[float, float | None], several: bool) -> str:
    now, mended = measured
    if mended is None:
        return f"{suspicion.found}."
    together = ", and mend the other findings" if several and suspicion.measured is None else ""
    return (
        f"{suspicion.found}: {suspicion.score} {now:.1f} -> {mended:.1f} mm if you "
        f"{suspicion.cure}{together}."
    )


def _scores(hands: Hands) -> dict[str, float]:
    rows = landmark_scores(HandPoints(hands.ground_truth), HandPoints(hands.prediction)).mean(dim=0)
    scores = dict(zip(LANDMARK_SCORES, (1000 * rows).tolist(), strict=True))
    return {name: value for name, value in scores.items() if math.isfinite(value)}
