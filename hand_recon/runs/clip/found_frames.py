"""Hands that were found in the frames of a clip, as a file with one frame to a line."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch

from hand_recon.detection.detector import DetectedHand, Side
from hand_recon.detection.tracking import TrackerState
from hand_recon.schema import HandEstimate, HandParameters

_ARRAYS: Final = ("landmarks_2d", "landmarks_3d", "confidence", "sigma", "box")
_PARAMETERS: Final = tuple(field.name for field in fields(HandParameters))


@dataclass(frozen=True)
class FoundFrame:
    """Hands of one frame before frames are compared."""

    number: int
    """Number of the frame, from 0."""
    time: float
    """Time since the first frame, seconds."""
    size: tuple[int, int]
    """Width and height, pixels."""
    hands: tuple[DetectedHand, ...]
    """Hands that were found."""
    state: TrackerState
    """State of the tracker after this frame."""
    estimate: HandEstimate | None = None
    """A network's estimate of each hand, σ in pixels; None without a network or without hands."""

    def to_line(self) -> str:
        """One line of JSON, from which `from_line` makes an equal frame."""
        content: dict[str, Any] = {
            "number": self.number,
            "time": self.time,
            "size": self.size,
            "hands": [_hand_to_json(hand) for hand in self.hands],
            "state": self.state.to_json(),
            "estimate": None if self.estimate is None else _estimate_to_json(self.estimate),
        }
        return json.dumps(content)

    @classmethod
    def from_line(cls, line: str) -> "FoundFrame":
        """Read what `to_line` wrote.

        Args:
            line: One line of JSON.

        Raises:
            ValueError: It is no such line, for example because a kill cut it.
        """
        try:
            read = json.loads(line)
            width, height = read["size"]
            return cls(
                read["number"],
                read["time"],
                (width, height),
                tuple(_hand_from_json(hand) for hand in read["hands"]),
                TrackerState.from_json(read["state"]),
                None if read["estimate"] is None else _estimate_from_json(read["estimate"]),
            )
        except (KeyError, TypeError, RecursionError, OverflowError, AttributeError) as error:
            raise ValueError(
                f"Expected a frame with its hands, found {line[:80]!r} ({error!r}). Delete the unfinished "
                "results, and start again."
            ) from error


def _hand_to_json(hand: DetectedHand) -> dict[str, Any]:
    content = {field.name: getattr(hand, field.name) for field in fields(DetectedHand)}
    arrays = {key: None if content[key] is None else content[key].tolist() for key in _ARRAYS}
    return content | arrays


def _hand_from_json(content: dict[str, Any]) -> DetectedHand:
    arrays = {
        key: None if content[key] is None else np.array(content[key], dtype=np.float64)
        for key in _ARRAYS
    }
    return DetectedHand(**(content | arrays))


def _estimate_to_json(estimate: HandEstimate) -> dict[str, Any]:
    seen = estimate.seen_pose
    return {
        "parameters": {
            name: getattr(estimate.parameters, name).double().tolist() for name in _PARAMETERS
        },
        "log_sigma": estimate.log_sigma.double().tolist(),
        "seen_pose": None if seen is None else seen.double().tolist(),
    }


def _estimate_from_json(content: dict[str, Any]) -> HandEstimate:
    parameters = {
        name: torch.tensor(content["parameters"][name], dtype=torch.float32) for name in _PARAMETERS
    }
    seen = content["seen_pose"]
    return HandEstimate(
        HandParameters(**parameters),
        torch.tensor(content["log_sigma"], dtype=torch.float64),
        None if seen is None else torch.tensor(seen, dtype=torch.float32),
    )


def with_side(frame: FoundFrame, place: int, side: Side) -> FoundFrame:
    """The frame with one hand alone, of a side that may be another than the one that was found.

    The estimate of a network that took it for a hand of the other side is of no use, and NaN.

    Args:
        frame: The frame.
        place: Index of the hand.
        side: `left` or `right`.
    """
    hand = frame.hands[place]
    estimate = None if frame.estimate is None else frame.estimate.select(slice(place, place + 1))
    if estimate is not None and side != hand.side:
        estimate = _unknown(estimate)
    return replace(frame, hands=(replace(hand, side=side),), estimate=estimate)


def _unknown(estimate: HandEstimate) -> HandEstimate:
    parameters = {
        name: torch.full_like(getattr(estimate.parameters, name), torch.nan) for name in _PARAMETERS
    }
    seen = estimate.seen_pose
    return HandEstimate(
        HandParameters(**parameters),
        estimate.log_sigma,
        None if seen is None else torch.full_like(seen, torch.nan),
    )


def whole_lines(path: Path) -> Iterator[str]:
    """Lines of a file that end as lines do, without what a kill left behind the last of them.

    Args:
        path: The file; nothing is read if it does not exist.
    """
    if not path.is_file():
        return
    with path.open(encoding="utf-8", newline="\n") as stream:
        for line in stream:
            if not line.endswith("\n"):
                return
            yield line[:-1]
