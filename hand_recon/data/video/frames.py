"""Frames of a video, and the interface of everything that gives them."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np
from jaxtyping import UInt8

ASSUMED_RATE: Final = 30.0
"""Frames per second where a source does not say."""


class VideoError(ValueError):
    """An input that gives no frames, or an output that cannot be written; the message says what to do."""


@dataclass(frozen=True)
class Frame:
    """One image of a video, upright."""

    number: int
    """Number in the source, from 0."""
    time: float
    """Time since the source's first frame, seconds; later than that of the frame before."""
    pixels: UInt8[np.ndarray, "height width 3"]
    """sRGB. The array belongs to this frame alone."""


class FrameSource(ABC):
    """A video file, stream, camera or sequence of images.

    A source that is opened is left with `with`, or by `close`.
    """

    name: str
    """Name for messages: a file's name, a stream's address without its password, or a camera's word."""
    size: tuple[int, int] | None = None
    """Width and height of upright frames, pixels; None if it is not known before the first frame."""
    count_hint: int | None = None
    """Number of frames by the container, which may be wrong; None if it does not say or has no end."""
    rate_hint: float | None = None
    """Mean frames per second by the container; None if it does not say."""
    files: tuple[Path, ...] = ()
    """Images of a sequence; none for a source that is one file, a camera or a stream."""
    is_live: bool = False
    """True if frames come as they happen: those that are not taken in time are lost."""

    @abstractmethod
    def frames(self, first: int = 0) -> Iterator[Frame]:
        """Iterate over the frames in order.

        Args:
            first: Number of the first frame that is given. Those before are passed over without the
                conversion to pixels; numbers and times are the same as without them.

        Raises:
            VideoError: The source cannot be read, or a live source is asked to pass over frames.
        """

    def __iter__(self) -> Iterator[Frame]:
        return self.frames()

    def close(self) -> None:  # noqa: B027  # most sources hold nothing between two iterations
        """Release the source. Nothing can be read after it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
