"""Options of `hand-recon predict` for videos: `motion.…`."""

from dataclasses import dataclass
from typing import Final

from hand_recon.detection.copies import COPIES
from hand_recon.detection.tracking import PALMS_EVERY
from hand_recon.motion.identity_settings import DEFAULT
from hand_recon.motion.smoothing import DEFAULT_SECONDS, checked_seconds

VIDEO_FORMATS: Final = ("webm", "mp4", "avi")
"""Formats of the drawn video."""


@dataclass(frozen=True)
class MotionOptions:
    """Options for hands over time.

    Raises:
        ValueError: An option is out of its range.
    """

    smoothing: float = DEFAULT_SECONDS
    """Time over which the motion of a typical hand is averaged, seconds; 0 for none (decision 78)."""
    live_smoothing: float = 0.06
    """The same for a camera or a stream, whose later frames are not known (decision 78)."""
    longest_gap: float = DEFAULT.longest_gap
    """Longest time without the hand that is bridged, seconds; 0 for none."""
    palms_every: int = PALMS_EVERY
    """Frames between searches for further hands while hands are followed (decision 80)."""
    copies: int = 0
    """Transformed copies of each hand's crop that are read for σ, as `detector.copies` of photographs
    (decision 80)."""
    fps: float | None = None
    """Frames per second of a folder or pattern of images, which makes it a video; None for photographs."""
    video: str | None = "webm"
    """Format of the video with the hands drawn on it, one of `VIDEO_FORMATS`; None for no video."""
    panels: bool = True
    """True to show each hand from the side, beside the video."""
    glb: bool = True
    """True for `hands.glb`, the moving hands as a skinned animation."""
    bvh: bool = False
    """True for a BVH file of each hand."""
    plot: bool = True
    """True for `angles.png`, which needs matplotlib."""
    limit: float | None = None
    """Time after which a camera or a stream is left, seconds; None for no limit."""
    processes: int = 2
    """Processes and threads that work at once."""

    def __post_init__(self) -> None:
        checked_seconds(self.smoothing)
        checked_seconds(self.live_smoothing)
        self._expect(
            "longest_gap",
            0 <= self.longest_gap <= DEFAULT.remember,
            f"0 (no bridges) to {DEFAULT.remember:g} s, after which a hand gets another number",
        )
        self._expect("palms_every", self.palms_every >= 1, "1 or more frames")
        self._expect("copies", 0 <= self.copies <= len(COPIES), f"0 to {len(COPIES)}")
        if self.limit is not None:
            self._expect("limit", self.limit > 0, "seconds above 0, or null for none")
        if self.video is not None and self.video not in VIDEO_FORMATS:
            raise ValueError(
                f"Found motion.video={self.video}; expected {', '.join(VIDEO_FORMATS)} or null for none."
            )
        self._expect("processes", self.processes >= 1, "1 or more")

    def _expect(self, name: str, is_right: object, expected: str) -> None:
        if not is_right:
            raise ValueError(f"Found motion.{name}={getattr(self, name)}; expected {expected}.")
