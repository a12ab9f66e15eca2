"""Lint checks of the landmark order and the frame order."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Final

import torch
from jaxtyping import Float, Int
from torch import Tensor

from hand_recon.hand.skeleton import LANDMARK_ORDERS, LANDMARKS, landmark_permutation
from hand_recon.protocols.benchmarks import Protocol
from hand_recon.protocols.lint.blocks import block_displacements
from hand_recon.protocols.lint.evidence import (
    Hands,
    Suspicion,
    certainty,
    clearly_better,
    shape_error,
    sizes,
    spread_evenly,
)

ORDER_GAIN: Final = 0.1
"""Least share of the error that another landmark order removes; two swapped fingertips cause a quarter."""

FRAME_GAIN: Final = 0.25
"""Least share of the error that another frame order removes."""

PROBES: Final = 200
"""Number of predictions whose ground truth is searched among all frames."""

FEWEST_PROBES: Final = 32
"""Least number of probes; with fewer, unrelated frames may fit worse by chance."""

ONE_FORM: Final = 1e-3
"""Difference of lengths, over the hand's size, below which two hands have the same shape."""

BY_CHANCE: Final = 0.45
"""Least mean share of frames that fit better than a prediction's own; ½ for unrelated frames."""

SAME_HAND: Final = 0.28
"""Shuffled frames: largest distance to the nearest hand, over that to the prediction's own frame. It is 0.22
with errors of 2 mm, and 0.31 for the nearest of 4,000 unrelated hands."""

DISTINCT: Final = 0.8
"""Least share of distinct nearest hands for shuffled frames, which have 0.95 and more; unrelated ones 0.5."""

MOST_BLOCKS: Final = 3
"""Most displaced blocks that a message describes."""

NAMES: Final = {
    "freihand": "FreiHAND's order (OpenPose's)",
    "ho3d": "HO3D's order",
    "known_hand": "KNOWN-Hand's order (MANO's joints, then the tips of thumb, index, middle, little, ring)",
    "dart": "DART's order (MANO's joints, then the tips of index, middle, little, ring, thumb)",
    "rhd": "RHD's order (each finger from tip to base)",
    "interhand": "InterHand2.6M's order (each finger from tip to base, wrist last)",
}
"""Descriptions of the orders of `LANDMARK_ORDERS` for messages."""

_MIRROR: Final = (-1.0, 1.0, 1.0)


def wrong_order(hands: Hands, protocol: Protocol) -> tuple[Hands, Suspicion | None]:
    """Check whether another known landmark order fits better, for right or for left hands.

    Returns:
        The hands in the order that fits, and the mistake if there is one.
    """
    now = _either_hand(hands.ground_truth, hands.prediction)
    own = LANDMARK_ORDERS[protocol.order]
    best: tuple[Tensor, tuple[str, ...], str] | None = None
    for names, label in _candidates(protocol.order):
        error = _either_hand(hands.ground_truth, hands.prediction[:, _indices(own, names)])
        if best is None or error.mean() < best[0].mean():
            best = error, names, label
    if best is None or not clearly_better(now, best[0], ORDER_GAIN):
        return hands, None
    error, names, label = best
    corrected = replace(hands, prediction=hands.prediction[:, _indices(own, names)])
    index = [names.index(name) for name in own]
    return corrected, Suspicion(
        "order",
        f"Your landmarks look to be {label}",
        f"reorder them by landmarks[{index}]",
        confidence=certainty(now, error),
    )


def _either_hand(ground_truth: Tensor, prediction: Tensor) -> Tensor:
    """Shape error of the hands or of their mirror images, whichever is smaller on average."""
    unmirrored = shape_error(ground_truth, prediction)
    mirrored = shape_error(ground_truth, prediction * prediction.new_tensor(_MIRROR))
    return unmirrored if unmirrored.mean() <= mirrored.mean() else mirrored


def _indices(own: tuple[str, ...], names: tuple[str, ...]) -> list[int]:
    """Permutation for landmarks that were read in the order `own` but were written in the order `names`."""
    return [LANDMARKS.index(own[names.index(name)]) for name in LANDMARKS]


def _candidates(own: str) -> Iterator[tuple[tuple[str, ...], str]]:
    """Every other landmark order with its description, common ones first, each once."""
    seen = {LANDMARK_ORDERS[own]}
    for names, label in _all_orders(own):
        if names not in seen:
            seen.add(names)
            yield names, label


def _all_orders(own: str) -> Iterator[tuple[tuple[str, ...], str]]:
    others = [name for name in LANDMARK_ORDERS if name != own]
    for name in others:
        yield LANDMARK_ORDERS[name], f"in {NAMES[name]}"
    yield (*LANDMARKS[1:], "wrist"), "in FreiHAND's order with the wrist last and not first"
    fingers = tuple(name for first in (17, 13, 9, 5, 1) for name in LANDMARKS[first : first + 4])
    yield ("wrist", *fingers), "in FreiHAND's order with the little finger first, the thumb last"
    for name in others:
        once, back = landmark_permutation(name, own), landmark_permutation(own, name)
        label = f"reordered from {NAMES[name]} to {NAMES[own]}"
        yield tuple(LANDMARK_ORDERS[own][index] for index in once), f"{label} once too often"
        yield tuple(LANDMARK_ORDERS[name][index] for index in back), f"{label} by the inverse map"


def wrong_frames(hands: Hands, all_ground_truth: Tensor) -> tuple[Hands, Suspicion | None]:
    """Check whether shifted, reversed, sorted or shuffled frames fit the predictions better.

    Args:
        hands: The inspected, evenly spaced frames, their landmarks in order.
        all_ground_truth: Ground truth of all frames.
    """
    count = len(all_ground_truth)
    frames = spread_evenly(count, max(1, len(hands.ground_truth)))
    now = _either_hand(hands.ground_truth, hands.prediction)
    best: tuple[Tensor, Tensor, str] | None = None
    for other, label in _other_frames(frames, count):
        inside = (other >= 0) & (other < count)
        error = _either_hand(all_ground_truth[other.clamp(0, count - 1)], hands.prediction)
        error = torch.where(inside, error, now)
        if best is None or error.mean() < best[0].mean():
            best = error, other.clamp(0, count - 1), label
    if best is not None and clearly_better(now, best[0], FRAME_GAIN):
        error, other, label = best
        return Hands(all_ground_truth[other], hands.prediction), Suspicion(
            "frame_order",
            f"Your frames look to be {label}",
            "write them in the order of the ground truth",
            confidence=certainty(now, error),
        )
    found = _moved_blocks(hands, all_ground_truth, frames)
    return _shuffled(hands, all_ground_truth, frames) if found is None else found


def _moved_blocks(
    hands: Hands, all_ground_truth: Tensor, frames: Tensor
) -> tuple[Hands, Suspicion] | None:
    """Check whether blocks of frames, such as sequences, are in another order."""
    forms = _descriptor(hands.prediction)
    if float((forms - forms[:1]).abs().amax()) < ONE_FORM:
        return None
    shifts = block_displacements(torch.cdist(forms, _descriptor(all_ground_truth)), frames)
    if shifts is None or not shifts.any():
        return None
    fitting = all_ground_truth[(frames + shifts).clamp(0, len(all_ground_truth) - 1)]
    moved = shifts != 0
    now, error = (
        _either_hand(ground_truth[moved], hands.prediction[moved])
        for ground_truth in (hands.ground_truth, fitting)
    )
    if not clearly_better(now, error, FRAME_GAIN):
        return None
    return Hands(fitting, hands.prediction), Suspicion(
        "frame_order",
        f"{_kind_of_displacement(shifts)}: {_described(frames, shifts)}",
        "write them in the order of the ground truth",
        confidence=certainty(now, error),
    )


def _kind_of_displacement(shifts: Tensor) -> str:
    if len(shifts[shifts != 0].unique()) == 1:
        return "Your frames look to be displaced, as after frames that are missing or doubled"
    return (
        "Your frames look to be in blocks in another order, as of sequences in the order of a folder and not "
        "of the benchmark's list (HO3D's evaluation.txt)"
    )


def _described(frames: Tensor, shifts: Tensor) -> str:
    """The largest displaced blocks, in the order of the file."""
    starts = [0, *((shifts[1:] != shifts[:-1]).nonzero()[:, 0] + 1).tolist(), len(shifts)]
    blocks = [(first, last - 1) for first, last in pairwise(starts) if int(shifts[first]) != 0]
    largest = sorted(sorted(blocks, key=lambda block: block[0] - block[1])[:MOST_BLOCKS])
    texts = []
    for first, last in largest:
        ends, shift = (int(frames[first]), int(frames[last])), int(shifts[first])
        texts.append(
            f"your frames {ends[0]} to {ends[1]} fit the ground truth of {ends[0] + shift} to "
            f"{ends[1] + shift}"
        )
    rest = len(blocks) - len(largest)
    return ", ".join(texts) + (f", and {rest} more" if rest else "")


def _other_frames(frames: Tensor, count: int) -> Iterator[tuple[Tensor, str]]:
    """Candidate frame of each prediction, with a description of the frame order."""
    yield frames + 1, "shifted: each prediction is of the next frame, the first one's is missing"
    yield (
        frames - 1,
        "shifted: each prediction is of the frame before, the first one is one too many",
    )
    yield count - 1 - frames, "in reverse"
    as_text = torch.tensor(sorted(range(count), key=str))
    yield as_text[frames], "sorted as text (1, 10, 100, 2, ...)"
    yield as_text.argsort()[frames], "sorted by number where the ground truth is sorted as text"


def _shuffled(
    hands: Hands, all_ground_truth: Tensor, frames: Tensor
) -> tuple[Hands, Suspicion | None]:
    probe = spread_evenly(len(frames), PROBES)
    forms = _descriptor(hands.prediction[probe])
    # If all predictions have the same shape, none fits its own frame better than others.
    if len(probe) < FEWEST_PROBES or float((forms - forms[:1]).abs().amax()) < ONE_FORM:
        return hands, None
    distance = torch.cdist(forms, _descriptor(all_ground_truth))
    own = distance[torch.arange(len(probe)), frames[probe]]
    nearest, match = distance.min(dim=1)
    if float((distance < own[:, None]).double().mean()) < BY_CHANCE:
        return hands, None
    same_hand = float((nearest / own.clamp(min=1e-12)).median()) < SAME_HAND
    if not same_hand or len(match.unique()) < DISTINCT * len(probe):
        return hands, Suspicion(
            "unrelated",
            "By their shape, your predictions fit their own frames no better than any other frame: they are "
            "shuffled, or of another test set, or the method ignores its image",
            confidence="note",
        )
    moved = int((match != frames[probe]).nonzero()[0, 0])
    return Hands(all_ground_truth[match], hands.prediction[probe]), Suspicion(
        "frame_order",
        "Your frames look to be shuffled: prediction "
        f"{int(frames[probe][moved])} fits the ground truth of frame {int(match[moved])}",
        "write them in the order of the ground truth",
    )


def _descriptor(points: Float[Tensor, "hand landmark=21 3"]) -> Float[Tensor, "hand pair"]:
    """Distances between landmarks over the hand's size, independent of position, rotation and side."""
    first, second = torch.triu_indices(21, 21, offset=1)
    lengths = torch.linalg.vector_norm(points[:, first] - points[:, second], dim=-1)
    return lengths / sizes(points).clamp(min=1e-12)[:, None]


def repeated_frames(
    ground_truth: Float[Tensor, "hand landmark=21 3"],
    prediction: Float[Tensor, "hand landmark=21 3"],
) -> Suspicion | None:
    """Check for predictions that are copies of the one before although their hands differ."""
    same = (prediction[1:] == prediction[:-1]).flatten(1).all(dim=1)
    same &= (ground_truth[1:] != ground_truth[:-1]).flatten(1).any(dim=1)
    rows: Int[Tensor, " row"] = same.nonzero()[:, 0]
    if len(rows) < max(2, len(ground_truth) / 100):
        return None
    return Suspicion(
        "repeated",
        f"{len(rows)} of your {len(prediction)} predictions are copies of the one before, the first at "
        f"frame {int(rows[0]) + 1}. Look for a loop that writes an old result, or an incomplete batch",
    )
