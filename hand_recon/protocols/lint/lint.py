"""Lint of a file of predictions: wrong landmark order, unit, axes, side or frame order.

The benchmarks' alignment allows every rotation, scale and reflection, and so hides half of these mistakes;
the others cost tens of millimetres that look like a bad method. Every hypothesis is scored, and reported only
where it lowers the error clearly beyond chance: large errors alone are not reported.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import torch
from torch import Tensor

from hand_recon.evaluation.scores import LANDMARK_SCORES, HandPoints, landmark_scores
from hand_recon.protocols.benchmarks import Protocol
from hand_recon.protocols.lint.axes import some_mirrored, wrong_axes
from hand_recon.protocols.lint.evidence import (
    Confidence,
    Hands,
    Suspicion,
    is_constant,
    sizes,
    spread_evenly,
)
from hand_recon.protocols.lint.groups import Frames, in_some_blocks, some_units
from hand_recon.protocols.lint.order import repeated_frames, wrong_frames, wrong_order
from hand_recon.protocols.lint.placement import (
    constant_note,
    flat,
    root_relative_note,
    wrong_unit,
)
from hand_recon.protocols.lint.surface import apart, without_correspondence

MAX_FRAMES: Final = 500
"""Most frames that are inspected, evenly spaced."""

MAX_MESHES: Final = 64
"""Most meshes that are inspected."""

MINIMUM_SIZE: Final = 1e-9
"""Size below which a hand is a single point, metres."""


@dataclass(frozen=True)
class Finding:
    """One mistake in a file of predictions, or one note on it."""

    kind: str
    """Identifier: `order`, `unit`, `some_unit`, `axes`, `mirrored`, `some_mirrored`, `position`,
    `frame_order`, `repeated`, `pixels`, `joints_and_vertices`, `vertex_order`; and the notes `root_relative`,
    `scale`, `constant`, `unrelated`, `no_extent`."""
    message: str
    """Description and remedy."""
    score_now: float
    """Score that shows the mistake, millimetres."""
    score_if_mended: float | None
    """The same score once this and all other findings are corrected; none where it cannot be known."""
    confidence: Confidence
    """`certain` or `likely` for a mistake, `note` for a fact that limits the scores."""

    @property
    def gain(self) -> float:
        """Decrease of the score once corrected, millimetres."""
        return 0.0 if self.score_if_mended is None else self.score_now - self.score_if_mended


def lint(
    ground_truth: HandPoints,
    prediction: HandPoints,
    protocol: Protocol,
    mesh: Tensor | None = None,
    names: Sequence[str] | None = None,
) -> tuple[Finding, ...]:
    """Find mistakes in predictions of at least one frame.

    Args:
        ground_truth: Ground truth in the protocol's order, axes and unit.
        prediction: The file's points, which should be in the same order, axes and unit; finite.
        protocol: Benchmark whose format the file has.
        mesh: The file's vertices, also where there are no true ones: frames × vertices × 3.
        names: Name of each frame, `<sequence>/<frame>`, for the messages; none if unknown.

    Returns:
        Mistakes, the costliest first, then notes; none for a file without mistakes, however large its errors.
    """
    all_ground_truth, all_hands = (
        protocol.to_internal(HandPoints(points.landmarks)).double().landmarks
        for points in (ground_truth, prediction)
    )
    frames = spread_evenly(len(all_ground_truth), MAX_FRAMES)
    hands = Hands(all_ground_truth[frames], all_hands[frames])
    if float(sizes(hands.prediction).median()) < MINIMUM_SIZE:
        found = "Most of your predictions are a single point, which no alignment can enlarge"
        return _scored([Suspicion("no_extent", found, confidence="note")], hands, hands)
    pixels = flat(hands)
    if pixels is not None:
        return _scored([pixels], hands, hands)
    every, of_units = some_units(Frames(all_ground_truth, all_hands, names), protocol)
    in_one_unit = Hands(hands.ground_truth, every.prediction[frames])
    corrected, suspicions = _correct(in_one_unit, every, protocol)
    suspicions = [*of_units, *suspicions]
    repeated = None if is_one_hand(suspicions) else repeated_frames(all_ground_truth, all_hands)
    found_in_mesh = _of_the_mesh(hands, corrected, (ground_truth, prediction, mesh), protocol)
    suspicions += [some for some in (repeated, *found_in_mesh) if some is not None]
    return _scored(suspicions, hands, corrected)


def closing_line(findings: Sequence[Finding]) -> str | None:
    """Sentence for a file without mistakes; None if there is one, or if a note says that there may be one."""
    open_questions = ("unrelated", "no_extent", "scale")
    if any(some.confidence != "note" or some.kind in open_questions for some in findings):
        return None
    return "No mistake found in order, unit, axes, side or sequence."


def is_one_hand(suspicions: list[Suspicion]) -> bool:
    """True if all predictions were found to be the same hand."""
    return any(suspicion.kind == "constant" for suspicion in suspicions)


def _correct(hands: Hands, every: Frames, protocol: Protocol) -> tuple[Hands, list[Suspicion]]:
    """Correct one mistake after the other, those of the shape before those of the position."""
    suspicions: list[Suspicion | None] = [constant_note(hands)]
    steps: list[Callable[[Hands], tuple[Hands, Suspicion | None]]] = [
        lambda some: wrong_unit(some, protocol),
        lambda some: wrong_order(some, protocol),
        lambda some: wrong_frames(some, every.ground_truth),
        lambda some: wrong_axes(some, protocol),
        some_mirrored,
        lambda some: _in_some_blocks(some, every, protocol),
    ]
    for step in steps:
        hands, suspicion = step(hands)
        suspicions.append(suspicion)
    suspicions.append(root_relative_note(hands))
    return hands, [suspicion for suspicion in suspicions if suspicion is not None]


def _in_some_blocks(
    hands: Hands, every: Frames, protocol: Protocol
) -> tuple[Hands, Suspicion | None]:
    """Check the order and the axes of consecutive groups of frames."""
    numbers = spread_evenly(len(every.ground_truth), MAX_FRAMES)
    if len(numbers) != len(hands.ground_truth) or is_constant(hands.prediction):
        return hands, None
    for step in (
        lambda some: wrong_order(some, protocol),
        lambda some: wrong_axes(some, protocol),
    ):
        corrected, suspicion = in_some_blocks(hands, numbers, step, every.names)
        if suspicion is not None:
            return corrected, suspicion
    return hands, None


def _of_the_mesh(
    hands: Hands,
    corrected: Hands,
    points: tuple[HandPoints, HandPoints, Tensor | None],
    protocol: Protocol,
) -> list[Suspicion | None]:
    ground_truth, prediction, mesh = points
    if mesh is None:
        mesh = prediction.vertices
    if mesh is None:
        return []
    frames = spread_evenly(len(mesh), MAX_FRAMES)
    few = spread_evenly(len(frames), MAX_MESHES)
    surface = _internal(mesh[frames[few]], hands.prediction[few], protocol)
    apart_from = apart(hands.prediction[few], surface)
    # Meshes are compared only where the frames are in order and their vertices can correspond.
    if (
        ground_truth.vertices is None
        or ground_truth.vertices.shape[1] != mesh.shape[1]
        or apart_from is not None
    ):
        return [apart_from]
    if len(corrected.ground_truth) != len(hands.ground_truth) or not torch.equal(
        corrected.ground_truth, hands.ground_truth
    ):
        return [apart_from]
    true_surface = _internal(ground_truth.vertices[frames[few]], hands.ground_truth[few], protocol)
    some = Hands(corrected.ground_truth[few], corrected.prediction[few])
    return [apart_from, without_correspondence(some, true_surface, surface)]


def _internal(surface: Tensor, landmarks: Tensor, protocol: Protocol) -> Tensor:
    vertices = protocol.to_internal(HandPoints(landmarks, surface.double())).vertices
    return surface if vertices is None else vertices


def _scored(suspicions: list[Suspicion], now: Hands, corrected: Hands) -> tuple[Finding, ...]:
    before, after = _scores(now), _scores(corrected)
    several = sum(suspicion.fix is not None for suspicion in suspicions) > 1
    findings = []
    for suspicion in suspicions:
        measured = suspicion.measured
        if measured is None:
            fixed = None if suspicion.fix is None else after[suspicion.score]
            measured = before[suspicion.score], fixed
        message = _message(suspicion, measured, several)
        findings.append(Finding(suspicion.kind, message, *measured, suspicion.confidence))
    return tuple(
        sorted(findings, key=lambda finding: (finding.confidence == "note", -finding.gain))
    )


def _message(suspicion: Suspicion, measured: tuple[float, float | None], several: bool) -> str:
    now, corrected = measured
    if corrected is None:
        return f"{suspicion.found}."
    together = ", and correct the other findings" if several and suspicion.measured is None else ""
    return (
        f"{suspicion.found}: {suspicion.score} {now:.1f} -> {corrected:.1f} mm if you "
        f"{suspicion.fix}{together}."
    )


def _scores(hands: Hands) -> dict[str, float]:
    rows = landmark_scores(HandPoints(hands.ground_truth), HandPoints(hands.prediction)).mean(dim=0)
    scores = dict(zip(LANDMARK_SCORES, (1000 * rows).tolist(), strict=True))
    return {name: value for name, value in scores.items() if math.isfinite(value)}
