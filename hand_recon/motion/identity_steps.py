"""Detections of one frame, assigned to the hands of the frames before (decision 80)."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from hand_recon.detection.detector import DetectedHand
from hand_recon.motion.identity_settings import DEFAULT, IdentitySettings
from hand_recon.motion.identity_tracks import SeenHand, hand_size, present, side_vote


@dataclass(frozen=True)
class FrameHands:
    """Detections of one frame."""

    number: int
    """Number of the frame in the clip, from 0."""
    time: float
    """Time of the frame, seconds."""
    hands: tuple[DetectedHand, ...]
    """The detections, in any order."""


@dataclass(frozen=True)
class IdentityState:
    """The hands that were seen up to a frame and are not forgotten."""

    hands: tuple[SeenHand, ...] = ()
    """The hands, by their numbers."""
    next_number: int = 1
    """Number of the next new hand."""
    time: float | None = None
    """Time of the frame, seconds; none before the first."""

    def hand(self, number: int) -> SeenHand:
        """The hand of a number.

        Raises:
            KeyError: It was forgotten, or there never was one.
        """
        return {hand.number: hand for hand in self.hands}[number]


def advance(
    state: IdentityState, frame: FrameHands, settings: IdentitySettings = DEFAULT
) -> tuple[IdentityState, tuple[int | None, ...]]:
    """Assign the detections of the next frame to hands.

    The result depends on nothing but the arguments, and not on the order of the detections. A number is given
    at once; `SeenHand.doubt` of the state's hand says whether it is worth showing.

    Args:
        state: The state after the frame before.
        frame: Time and detections.
        settings: Settings of identity.

    Returns:
        The state after this frame, and the number of each detection's hand; none for one with fewer than
        three landmarks, or all at one place.

    Raises:
        ValueError: The frame is not later than the one before.
    """
    if state.time is not None and frame.time <= state.time:
        raise ValueError(
            f"Frame {frame.number} is at {frame.time:g} s, and the one before it at {state.time:g} s; "
            "expected times that increase."
        )
    step = 0.0 if state.time is None else frame.time - state.time
    known = [hand for hand in state.hands if frame.time - hand.time <= settings.remember]
    usable = [index for index, hand in enumerate(frame.hands) if hand_size(hand.landmarks_2d) > 0]
    # From here on, the order of the detections is that of their contents.
    usable.sort(key=lambda index: _order(frame.hands[index]))
    detections = [frame.hands[index] for index in usable]
    costs = match_costs(known, detections, frame.time, settings)
    assigned = _assign(costs, settings)
    after = {hand.number: hand for hand in known}
    numbers: list[int | None] = [None] * len(frame.hands)
    next_number = state.next_number
    for column, (index, hand) in enumerate(zip(usable, detections, strict=True)):
        if column in assigned:
            before = known[assigned[column]]
        else:
            before = SeenHand(next_number, frame.time, hand.landmarks_2d, hand.side)
            next_number += 1
        numbers[index] = before.number
        after[before.number] = before.seen_again(hand, frame.time, step, settings)
    return IdentityState(tuple(after.values()), next_number, frame.time), tuple(numbers)


def match_costs(
    known: list[SeenHand],
    detections: list[DetectedHand],
    time: float,
    settings: IdentitySettings = DEFAULT,
) -> Float[np.ndarray, "known detection"]:
    """Negative logarithm of the likelihood that a detection is of a known hand, up to a constant.

    The sum of three terms: the landmarks' distance from where they are expected, a Gaussian whose standard
    deviation grows with the time since the hand was seen; the logarithm of the ratio of sizes, a Gaussian;
    and the probability that both have the same side, over that by chance.

    Args:
        known: Hands of earlier frames.
        detections: Detections of this frame, with a size each.
        time: Time of this frame, seconds.
        settings: Settings of identity.

    Returns:
        Costs, infinite where a pair has no landmark in common.
    """
    costs = [[_cost(one, hand, time, settings) for hand in detections] for one in known]
    return np.array(costs, dtype=np.float64).reshape(len(known), len(detections))


def _cost(known: SeenHand, hand: DetectedHand, time: float, settings: IdentitySettings) -> float:
    offsets = present(hand.landmarks_2d - known.expected(time, settings))
    if not len(offsets):
        return math.inf
    sizes = hand_size(known.landmarks), hand_size(hand.landmarks_2d)
    distance = math.sqrt(float(np.square(offsets).sum(axis=1).mean()) / (sizes[0] * sizes[1]))
    growth = math.hypot(1.0, settings.speed_spread / settings.place_spread * (time - known.time))
    place = 0.5 * (distance / (settings.place_spread * growth)) ** 2 + 2 * math.log(growth)
    size = 0.5 * (math.log(sizes[0] / sizes[1]) / settings.size_spread) ** 2
    limit = settings.side_limit
    known_right = _probability(min(max(known.side_votes, -limit), limit))
    right = _probability(side_vote(hand, settings))
    same = known_right * right + (1 - known_right) * (1 - right)
    return place + size - math.log(2 * same)


def _assign(
    costs: Float[np.ndarray, "known detection"], settings: IdentitySettings
) -> dict[int, int]:
    """Pairs of least cost, each hand and each detection once: index of the known hand by the detection's."""
    # A pair is worth as much as it costs less than two hands of their own.
    worth = np.clip(settings.largest_cost - costs, 0, None)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    return {
        int(column): int(row)
        for row, column in zip(rows, columns, strict=True)
        if worth[row, column] > 0
    }


def _order(hand: DetectedHand) -> tuple[float, ...]:
    """Sorting key of a detection: the highest score first, then by place."""
    x, y = present(hand.landmarks_2d).mean(axis=0).tolist()
    return (-(hand.score or 0.0), -hand.side_score, y, x)


def _probability(log_odds: float) -> float:
    return 1 / (1 + math.exp(-log_odds))
