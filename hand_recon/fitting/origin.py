"""Origin of a hand that is fitted: its image, its camera and the steps that led to its landmarks."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Moment:
    """Place of a hand in a clip."""

    hand: int
    """Number of the hand, from 1: the same in all frames."""
    frame: int
    """Number of the frame, from 0."""
    time: float
    """Time since the first frame, seconds."""
    seen: bool = True
    """True if the hand was found in this frame; false if a gap between others was bridged."""


@dataclass(frozen=True)
class Origin:
    """Entries of a hand in a file of hands besides the result of the fit."""

    image: str | None = None
    """File name of the image; None without one."""
    image_size: tuple[int, int] | None = None
    """Width and height of the image, pixels; None if unknown."""
    score: float | None = None
    """Detector's score of the hand, 0 to 1; None without one."""
    camera: str = "assumed"
    """Source of the camera matrix, one of `hand_recon.fitting.hand_records.CAMERAS`."""
    source: str = "landmarks, fit"
    """Steps that made the hand."""
    hand_model: str = "open"
    """Hand model that was fitted, `open` or `mano`."""
    moment: Moment | None = None
    """Place in a clip; None for photographs and for landmarks alone."""
