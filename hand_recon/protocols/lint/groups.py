"""Lint checks of mistakes in a part of the frames, which a median over all frames does not show."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import torch
from jaxtyping import Float, Int
from torch import Tensor

from hand_recon.evaluation.point_error import point_errors
from hand_recon.protocols.benchmarks import UNITS, Protocol
from hand_recon.protocols.lint.evidence import Hands, Suspicion, sizes
from hand_recon.protocols.lint.frames import frame_ranges, sequences_of
from hand_recon.protocols.lint.placement import ABOUT

BLOCKS: Final = 8
"""Number of consecutive groups into which the inspected frames are divided."""

FEWEST_IN_BLOCK: Final = 12
"""Least number of inspected frames of a group that is judged by itself."""

Step = Callable[[Hands], tuple[Hands, Suspicion | None]]


@dataclass(frozen=True)
class Frames:
    """Points of all frames of a file, in FreiHAND's order, OpenCV's axes and metres unless it is wrong."""

    ground_truth: Float[Tensor, "frame landmark=21 3"]
    """True landmarks."""
    prediction: Float[Tensor, "frame landmark=21 3"]
    """Predicted landmarks."""
    names: Sequence[str] | None = None
    """Name of each frame, `<sequence>/<frame>`, where it is known."""


def some_units(frames: Frames, protocol: Protocol) -> tuple[Frames, list[Suspicion]]:
    """Check the unit of each frame by its hand's size, and correct the frames that differ from others.

    A file whose frames all are in one unit, right or wrong, is returned as it is.
    """
    factors = _unit_factors(frames, protocol)
    known = factors[factors.isfinite()]
    if len(known) == 0 or bool((known == known[0]).all()):
        return frames, []
    usual = torch.where(factors.isfinite(), factors, 1.0)
    corrected = frames.prediction * usual[:, None, None]
    suspicions = []
    for unit, metres in UNITS.items():
        factor = metres / UNITS[protocol.unit]
        wrong = factors == factor
        if unit == protocol.unit or not wrong.any():
            continue
        only = torch.where(wrong[:, None, None], corrected, frames.prediction)
        count = int(wrong.sum())
        suspicions.append(
            Suspicion(
                "some_unit",
                f"{count} of your {len(wrong)} frames ({_percent(count, len(wrong))}) look to be in {unit} "
                f"and the others are not; {protocol.name} wants {protocol.unit}: frames "
                f"{frame_ranges(wrong.nonzero()[:, 0])}{sequences_of(frames.names, wrong)}",
                f"multiply these by {factor:g}",
                score="E_J_unaligned",
                confidence="certain",
                measured=(_unaligned(frames), _unaligned(replace(frames, prediction=only))),
            )
        )
    return replace(frames, prediction=corrected), suspicions


def _unit_factors(frames: Frames, protocol: Protocol) -> Float[Tensor, " frame"]:
    """Factor that converts each frame to the protocol's unit; NaN where its size is that of no unit."""
    ratio = sizes(frames.prediction) / sizes(frames.ground_truth).clamp(min=1e-12)
    logs = ratio.clamp(min=1e-12).log()
    factors = torch.full_like(logs, torch.nan)
    for metres in UNITS.values():
        factor = metres / UNITS[protocol.unit]
        near = (logs + math.log(factor)).abs() < math.log(ABOUT)
        factors = torch.where(near, torch.full_like(logs, factor), factors)
    return factors


def _unaligned(frames: Frames) -> float:
    return 1000 * float(point_errors(frames.ground_truth, frames.prediction).mean())


def _percent(count: int, of: int) -> str:
    return f"{100 * count / of:.2g} %"


def in_some_blocks(
    hands: Hands, numbers: Int[Tensor, " hand"], step: Step, names: Sequence[str] | None = None
) -> tuple[Hands, Suspicion | None]:
    """Apply a check to consecutive groups of frames, after it found nothing in all frames together.

    Args:
        hands: The inspected frames.
        numbers: Number of each inspected frame in the file.
        step: The check.
        names: Name of each frame of the file, where it is known.

    Returns:
        The hands with the wrong groups corrected, and the commonest mistake, if there is one.
    """
    blocks = torch.arange(len(numbers)).chunk(BLOCKS)
    if len(blocks) < 2 or min(map(len, blocks)) < FEWEST_IN_BLOCK:
        return hands, None
    found: dict[str, tuple[Suspicion, list[tuple[Tensor, Hands]]]] = {}
    for block in blocks:
        some, suspicion = step(Hands(hands.ground_truth[block], hands.prediction[block]))
        if suspicion is not None and suspicion.fix is not None:
            found.setdefault(suspicion.fix, (suspicion, []))[1].append((block, some))
    if not found:
        return hands, None
    suspicion, parts = max(found.values(), key=lambda entry: len(entry[1]))
    points = hands.prediction.clone()
    wrong = torch.zeros(len(numbers), dtype=torch.bool)
    for block, some in parts:
        points[block] = some.prediction
        wrong[block] = True
    gap = int((numbers[1:] - numbers[:-1]).max())
    every = torch.zeros(int(numbers[-1]) + gap, dtype=torch.bool)
    every[numbers[wrong]] = True
    named = sequences_of(names, every[: len(names)]) if names else ""
    where = f"about frames {frame_ranges(numbers[wrong], gap)}{named}"
    return Hands(hands.ground_truth, points), replace(
        suspicion,
        found=f"A part of your frames ({where}) differs from the others. {suspicion.found}",
        fix=f"correct these alone: {suspicion.fix}",
        # Consecutive frames are alike, so that a group is less evidence than its number of frames says.
        confidence="likely",
    )
