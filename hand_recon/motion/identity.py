"""Hands of a clip that keep their number and side over all frames (decision 80)."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from hand_recon.detection.detector import Side
from hand_recon.motion.identity_settings import DEFAULT, IdentitySettings
from hand_recon.motion.identity_steps import FrameHands, IdentityState, advance
from hand_recon.motion.identity_tracks import SeenHand


@dataclass(frozen=True)
class Gap:
    """Successive frames in which a hand was not seen, between others in which it was."""

    frames: Int[np.ndarray, " frame"]
    """Numbers of the frames."""
    seconds: float
    """Time from the last detection before to the first one after, seconds."""
    is_bridged: bool
    """True if that is at most `longest_gap`."""


@dataclass(frozen=True)
class Track:
    """One hand of a clip: its detections, with one number and one side."""

    number: int
    """Number of the hand, from 1, in the order of appearance."""
    side: Side
    """Side by the votes of all detections, weighted by their scores."""
    agreement: float
    """Share of the detections that have this side themselves; a low one hints at two hands mixed up."""
    mean_score: float | None
    """Mean score of the detections; none where they have no scores."""
    frames: Int[np.ndarray, " frame"]
    """Numbers of the frames in which the hand was seen, increasing."""
    times: Float[np.ndarray, " frame"]
    """Times of these frames, seconds."""
    detections: Int[np.ndarray, " frame"]
    """Index of the detection in each of these frames."""
    gaps: tuple[Gap, ...]
    """The gaps between the first and the last of these frames, in order."""


@dataclass(frozen=True)
class Identities:
    """Hands of a clip."""

    tracks: tuple[Track, ...]
    """The hands, by their numbers."""
    numbers: tuple[tuple[int | None, ...], ...]
    """Number of the hand of each detection, for every frame; none for a detection that was dropped."""
    dropped: tuple[str, ...]
    """One sentence for each hand that was dropped as a false detection."""


def identify(frames: Sequence[FrameHands], settings: IdentitySettings = DEFAULT) -> Identities:
    """Assign the detections of a clip to hands that keep their number and side.

    Hands that are seen for too short a time, or with too low a score, are dropped and said.

    Args:
        frames: All frames of the clip in order, those without a detection, too.
        settings: Settings of identity.

    Raises:
        ValueError: Times do not increase.
    """
    seen: dict[int, SeenHand] = {}
    places: dict[int, list[tuple[int, int]]] = {}
    given: list[tuple[int | None, ...]] = []
    state = IdentityState()
    for place, frame in enumerate(frames):
        state, numbers = advance(state, frame, settings)
        given.append(numbers)
        for index, number in enumerate(numbers):
            if number is not None:
                seen[number] = state.hand(number)
                places.setdefault(number, []).append((place, index))
    tracks: list[Track] = []
    dropped: list[str] = []
    kept: dict[int | None, int] = {}
    length = frames[-1].time - frames[0].time if frames else 0.0
    for number in sorted(seen):
        doubt = seen[number].doubt(settings, length)
        if doubt is None:
            kept[number] = len(tracks) + 1
            tracks.append(_track(kept[number], seen[number], frames, places[number], settings))
        else:
            first, last = (frames[places[number][end][0]].number for end in (0, -1))
            dropped.append(f"a hand in frames {first} to {last} is left out: {doubt}")
    numbers_kept = tuple(tuple(kept.get(number) for number in row) for row in given)
    return Identities(tuple(tracks), numbers_kept, tuple(dropped))


def _track(
    number: int,
    hand: SeenHand,
    frames: Sequence[FrameHands],
    places: list[tuple[int, int]],
    settings: IdentitySettings,
) -> Track:
    """The record of a hand that was seen in some places, each the index of a frame and of a detection."""
    sides = [frames[place].hands[index].side for place, index in places]
    indices = [place for place, _ in places]
    return Track(
        number=number,
        side=hand.side,
        agreement=sides.count(hand.side) / len(sides),
        mean_score=hand.mean_score,
        frames=np.array([frames[place].number for place in indices]),
        times=np.array([frames[place].time for place in indices], dtype=np.float64),
        detections=np.array([index for _, index in places]),
        gaps=tuple(
            _gap(frames[before : after + 1], settings)
            for before, after in pairwise(indices)
            if after - before > 1
        ),
    )


def _gap(frames: Sequence[FrameHands], settings: IdentitySettings) -> Gap:
    """The gap within some frames, of which the first and the last have the hand."""
    seconds = frames[-1].time - frames[0].time
    inside = np.array([frame.number for frame in frames[1:-1]])
    return Gap(inside, seconds, seconds <= settings.longest_gap)
