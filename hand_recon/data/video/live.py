"""Cameras and live streams: the newest frame, whatever the delay of what is done with it."""

import logging
import threading
import time
from collections.abc import Callable, Iterator

import cv2
import numpy as np

from hand_recon.data.video.capture import Capture, grabbed, pixels_of
from hand_recon.data.video.files import rate_of
from hand_recon.data.video.frames import Frame, FrameSource, VideoError

logger = logging.getLogger(__name__)

_PATIENCE = 0.5
"""Seconds between two looks for an interruption while waiting for a frame."""
_FAREWELL = 5.0
"""Seconds that a camera gets to give its last frame when it is closed."""


class LiveSource(FrameSource):
    """Frames as they happen. A thread keeps the newest one alone, so that the delay does not grow.

    Times are those of a monotonic clock when each frame arrived; frames are numbered as they are taken.
    """

    is_live = True

    def __init__(
        self, name: str, capture: Capture, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Take over an opened capture, which is released at the end of the iteration or by `close`.

        Args:
            name: Name for messages.
            capture: Camera or stream.
            clock: Seconds that never decrease.
        """
        self.name = name
        width, height = (
            int(capture.get(which)) for which in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )  # fmt: skip
        self.size = (width, height) if width > 0 and height > 0 else None
        self.rate_hint = rate_of(capture)
        self.lost = 0
        """Number of frames that came while the one before them was still to be taken."""
        self._capture = capture
        self._clock = clock
        self._changed = threading.Condition()
        self._newest: tuple[float, np.ndarray] | None = None
        self._ended = False
        self._error: BaseException | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None

    def frames(self, first: int = 0) -> Iterator[Frame]:
        """Iterate over the newest frames until the source ends or is closed.

        Raises:
            VideoError: `first` is not 0, the source gives no frame at all, or it was read before.
        """
        if first:
            raise VideoError(
                f"{self.name} is live: its first {first} frames are gone. Begin anew, with another output."
            )
        if self._thread is not None or self._closing.is_set():
            raise VideoError(f"{self.name} was read already; open it again to read what comes now.")
        return self._taken()

    def close(self) -> None:
        """Stop the thread, which releases the camera. A running iteration ends."""
        self._closing.set()
        with self._changed:
            self._changed.notify_all()
        if self._thread is None:
            self._capture.release()
        elif self._thread is not threading.current_thread():
            self._thread.join(_FAREWELL)

    def _taken(self) -> Iterator[Frame]:
        self._thread = threading.Thread(target=self._keep_newest, name=self.name, daemon=True)
        self._thread.start()
        number, start, last = 0, 0.0, -1.0
        try:
            while (newest := self._wait()) is not None:
                arrived, pixels = newest
                start = start if number else arrived
                # Two frames may arrive within one step of a coarse clock.
                last = max(arrived - start, np.nextafter(last, np.inf)) if number else 0.0
                yield Frame(number, float(last), pixels)
                number += 1
            was_closed = self._closing.is_set()
        finally:
            self.close()
        if self._error is not None:
            raise self._error
        if was_closed:
            return
        if number == 0:
            raise VideoError(
                f"{self.name} opens but gives no frame. Another program may use the camera, or the stream "
                "may have ended; close other programs, and try it in a player."
            )
        logger.info("%s gives no more frames; it ended after %d.", self.name, number)

    def _wait(self) -> tuple[float, np.ndarray] | None:
        with self._changed:
            while self._newest is None and not self._ended and not self._closing.is_set():
                self._changed.wait(_PATIENCE)
            newest, self._newest = self._newest, None
            return None if self._closing.is_set() else newest

    def _keep_newest(self) -> None:
        try:
            while not self._closing.is_set() and grabbed(self._capture):
                arrived = self._clock()
                pixels = pixels_of(self._capture)
                if pixels is None:
                    continue
                with self._changed:
                    self.lost += self._newest is not None
                    self._newest = arrived, pixels
                    self._changed.notify_all()
        except BaseException as error:  # noqa: BLE001  # it is raised where the frames are taken
            self._error = error
        finally:
            self._capture.release()
            with self._changed:
                self._ended = True
                self._changed.notify_all()
