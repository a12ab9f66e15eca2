"""Origin of a hand that is fitted: its image, its camera and the steps that led to its landmarks."""

from dataclasses import dataclass


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
