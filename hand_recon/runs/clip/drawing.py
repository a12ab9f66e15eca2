"""Draws the hands of a clip over its frames, some frames at once."""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Int, UInt8

from hand_recon.data.video.ahead import ahead
from hand_recon.data.video.frames import Frame, FrameSource, VideoError
from hand_recon.data.video.writer import VideoWriter
from hand_recon.motion.trajectory import Trajectory
from hand_recon.runs.clip.results import FrameOfHands
from hand_recon.visualization.clip_frame import MOST_PANELS, ClipLayout, draw_clip_frame

Drawing = UInt8[np.ndarray, "height width 3"]

WAITING: Final = 2
"""Frames that wait to be drawn, for each thread."""


def layout_of(motions: Sequence[Trajectory], *, panels: bool) -> ClipLayout:
    """Layout of a clip's drawings: hands that are longest in the clip have panels, by their numbers.

    Args:
        motions: Motion of every hand.
        panels: Whether hands are shown from the side, too.
    """
    longest = sorted(motions, key=lambda motion: (-len(motion), motion.hand))
    shown = [motion.hand for motion in longest][:MOST_PANELS]
    titles = {one.hand: f"{one.hand}, {one.side}" for one in motions if one.hand in shown}
    return ClipLayout(titles, panels)


def draw_video(
    path: Path,
    source: FrameSource,
    hands: Iterable[FrameOfHands],
    faces: Int[np.ndarray, "face 3"],
    layout: ClipLayout,
    *,
    threads: int,
) -> None:
    """Draw a video.

    Args:
        path: Video to write, in the place of what an interrupted command left.
        source: The frames, which are read again.
        hands: Hands of every frame, in order.
        faces: Triangles of the mesh.
        layout: Panels beside the frames.
        threads: Frames that are drawn at once.

    Raises:
        VideoError: The frames cannot be read, or the video cannot be written.
    """
    for earlier in (path, *path.parent.glob(f".{path.stem}.*{path.suffix}")):
        earlier.unlink(missing_ok=True)
    drawn = _drawings(source, hands, faces, layout, threads)
    # Encoding takes as long as drawing, and leaves Python to the other threads meanwhile.
    with VideoWriter(path, fps=source.rate_hint) as video, closing(ahead(drawn)) as drawings:
        for drawing, time in drawings:
            video.write(drawing, time)


def _drawings(
    source: FrameSource,
    hands: Iterable[FrameOfHands],
    faces: Int[np.ndarray, "face 3"],
    layout: ClipLayout,
    threads: int,
) -> Iterator[tuple[Drawing, float]]:
    """Frames with their hands, each with its time; arguments as for `draw_video`."""
    with (
        ThreadPoolExecutor(threads) as pool,
        closing(ahead(source.frames())) as frames,
    ):

        def draw(frame: Frame, of_frame: FrameOfHands) -> tuple[Drawing, float]:
            caption = f"{frame.time:.2f} s"
            return draw_clip_frame(frame.pixels, of_frame.drawn, faces, layout, caption), frame.time

        waiting: list[Future[tuple[Drawing, float]]] = []
        for frame, of_frame in zip(frames, hands, strict=False):
            if frame.number != of_frame.number:
                raise VideoError(
                    f"{source.name} has other frames than when its hands were found: {frame.number} in the "
                    f"place of {of_frame.number}. Repeat the command with another output."
                )
            waiting.append(pool.submit(draw, frame, of_frame))
            if len(waiting) > WAITING * threads:
                yield waiting.pop(0).result()
        for rest in waiting:
            yield rest.result()
