"""Finds the hands of every frame of a clip, so that an interrupted command goes on behind the last frame."""

import logging
import os
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import UInt8

from hand_recon.data.progress import with_progress
from hand_recon.data.video.ahead import ahead
from hand_recon.data.video.frames import Frame, FrameSource, VideoError
from hand_recon.detection.detector import DetectedHand, Detections, Detector
from hand_recon.detection.mediapipe import MediaPipeDetector
from hand_recon.detection.tracking import HandTracker, TrackerState
from hand_recon.fitting.photo_camera import CameraChoice
from hand_recon.runs.clip.found_frames import FoundFrame, whole_lines
from hand_recon.runs.photo_network import PhotoNetwork
from hand_recon.schema import HandEstimate

logger = logging.getLogger(__name__)

END: Final = "end"
"""Line behind the last frame of a clip that was read to its end."""

Pixels = UInt8[np.ndarray, "height width 3"]
Follow = Callable[[Pixels, TrackerState], tuple[Detections, TrackerState]]
"""From a frame, and what the frame before left, to the hands and what the next frame needs."""

Look = Callable[
    [Pixels, tuple[DetectedHand, ...]], tuple[tuple[DetectedHand, ...], HandEstimate | None]
]
"""From a frame and its hands to the hands with landmarks and a network's estimate."""


def follower(detector: Detector, palms_every: int, copies: int) -> Follow:
    """Function that finds the hands of successive frames.

    Args:
        detector: MediaPipe's, which follows hands from frame to frame, or any other one.
        palms_every: Frames between searches for palms while hands are followed.
        copies: Transformed copies of a followed hand's crop that are read for σ.
    """
    if isinstance(detector, MediaPipeDetector):
        return HandTracker(detector, palms_every, copies=copies)

    def alone(pixels: Pixels, state: TrackerState) -> tuple[Detections, TrackerState]:
        return detector(pixels, None), state

    return alone


def looker(network: PhotoNetwork, choice: CameraChoice) -> Look:
    """Function that has a network look at the hands of a frame.

    Args:
        network: The network.
        choice: Rule for the camera. Where it is assumed, it is not yet known how large the hands of the clip
            are; the fit takes the angles and rotations from here, and places the hands itself.
    """

    def look(
        pixels: Pixels, hands: tuple[DetectedHand, ...]
    ) -> tuple[tuple[DetectedHand, ...], HandEstimate | None]:
        height, width, _ = pixels.shape
        if choice.cameras is None:
            camera = choice.of_photo((width, height), None, np.zeros(0)).matrix
        else:
            camera = np.asarray(choice.cameras.matrices[0], dtype=np.float64)
        found, by_network = network.find(pixels, hands)
        return network.place(pixels, found, by_network, camera)

    return look


@dataclass(frozen=True)
class Finding:
    """The frames of a clip and what finds their hands."""

    source: FrameSource
    """The clip."""
    follow: Follow
    """Finds the hands."""
    look: Look | None = None
    """Has a network look at the hands; None without one."""

    def into(self, path: Path) -> list[FoundFrame]:
        """Find the hands of all frames, or of those that are not in the file yet.

        Args:
            path: File of the frames, a line each; it is extended frame by frame.

        Returns:
            All frames.

        Raises:
            VideoError: The clip cannot be read, or changes its size.
        """
        lines = list(whole_lines(path))
        is_done = bool(lines) and lines[-1] == END
        found = [FoundFrame.from_line(line) for line in lines[: -1 if is_done else None]]
        if is_done:
            return found
        if found:
            logger.info("%d frames of %s are done already.", len(found), self.source.name)
        with path.open("a", encoding="utf-8") as stream:
            # Without the part of a line that a kill left.
            stream.truncate(sum(len(line.encode()) + 1 for line in lines))
            for frame in self._further(found):
                found.append(frame)
                stream.write(frame.to_line() + "\n")
                stream.flush()
            stream.write(END + "\n")
            stream.flush()
            os.fsync(stream.fileno())
        return found

    def _further(self, found: list[FoundFrame]) -> Iterator[FoundFrame]:
        """The frames behind those that are done."""
        state = found[-1].state if found else TrackerState()
        size = found[0].size if found else None
        count = self.source.count_hint
        total = None if count is None else max(count - len(found), 1)
        task = f"Finding the hands of {self.source.name}, frames"
        # A frame that could not be decoded has a number, too.
        first = found[-1].number + 1 if found else 0
        with closing(ahead(self.source.frames(first))) as frames:
            for frame in with_progress(frames, total, task):
                one = self.of_frame(frame, state)
                size = size or one.size
                if one.size != size:
                    raise VideoError(
                        f"Frame {frame.number} of {self.source.name} has {one.size[0]} × {one.size[1]} "
                        f"pixels, and the first has {size[0]} × {size[1]}; expected one size. Cut the clip "
                        "there."
                    )
                state = one.state
                yield one

    def of_frame(self, frame: Frame, state: TrackerState) -> FoundFrame:
        """Find the hands of one frame.

        Args:
            frame: The frame.
            state: State of the tracker after the frame before.
        """
        detections, state = self.follow(frame.pixels, state)
        hands, estimate = detections.hands, None
        if self.look is not None and hands:
            hands, estimate = self.look(frame.pixels, hands)
        height, width, _ = frame.pixels.shape
        return FoundFrame(frame.number, frame.time, (width, height), hands, state, estimate)
