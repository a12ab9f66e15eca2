"""Hands before a camera, as they move: `hand-recon predict webcam`, and streams."""

import logging
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, Final, TextIO

from omegaconf import DictConfig, OmegaConf

from hand_recon.data.video.ahead import ahead
from hand_recon.data.video.frames import Frame, FrameSource
from hand_recon.data.video.writer import VideoWriter
from hand_recon.detection.tracking import TrackerState
from hand_recon.fitting.hands_lines import write_lines
from hand_recon.fitting.photo_camera import parse_camera
from hand_recon.runs.clip.checks import check_clip
from hand_recon.runs.clip.finding import Finding, follower
from hand_recon.runs.clip.found_frames import FoundFrame
from hand_recon.runs.clip.live_hands import LiveHands
from hand_recon.runs.clip.live_window import open_window
from hand_recon.runs.clip.options import MotionOptions
from hand_recon.runs.clip.results import FrameOfHands, clip_products, counts_of, frames_of_hands
from hand_recon.runs.clip.smoothed import ClipPoses
from hand_recon.runs.configuration import build_hand, instantiate, plain
from hand_recon.runs.fit_run import source_of
from hand_recon.runs.fitters import build_objective
from hand_recon.runs.looking import build_detector, steps_before
from hand_recon.runs.results import write_json
from hand_recon.runs.unfinished import claim_or_resume, finish, results_folder
from hand_recon.visualization.clip_frame import ClipLayout, draw_clip_frame

logger = logging.getLogger(__name__)

RATE_OVER: Final = 30
"""Frames over which the rate that is shown is averaged."""


def predict_live(config: DictConfig, source: FrameSource) -> dict[str, Any]:
    """Reconstruct the hands before a camera or of a stream until it ends, or the user does.

    Every frame goes through finding, fitting and drawing at once in threads of their own; frames that come
    while all of them are busy are passed over.

    Args:
        config: `conf/predict.yaml` composed and adapted.
        source: The frames.

    Returns:
        Numbers of frames, hands in frames, and frames per second.

    Raises:
        ValueError: The source gives no frame, or an option is for files, such as a network.
    """
    if config.ckpt is not None:
        raise ValueError(
            "ckpt=… is for photographs and video files: a network that looks at every frame is too slow for "
            "a camera. Leave ckpt out."
        )
    check_clip(config)
    folder = results_folder(config)
    # Of this moment alone: nothing goes on where a camera was left.
    claim_or_resume(folder, clip_products(folder), {"started": time.time()})
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    logger.info(
        "Reconstructing the hands of %s into %s; Ctrl-C, or q in the window, ends it.",
        source.name, folder,
    )  # fmt: skip
    summary = _Live(config, source, folder).run()
    write_json(folder / "clip.json", summary)
    finish(folder)
    return summary


class _Live:
    """The threads of a live view, and what becomes of their frames."""

    def __init__(self, config: DictConfig, source: FrameSource, folder: Path) -> None:
        self.source, self.folder = source, folder
        self.options: MotionOptions = instantiate(config.motion)
        detector = build_detector(config)
        self.hand = build_hand(config)
        follow = follower(detector, self.options.palms_every, self.options.copies)
        self.finding = Finding(source, follow)
        origin = source_of(config, self.hand, steps_before(detector, None))
        self.live = LiveHands(
            config, parse_camera(str(config.camera), 1), origin, self.options.live_smoothing
        )
        objective = build_objective(config, self.hand)
        self.poses = ClipPoses(
            objective,
            instantiate(config.descent),
            config.sigma_at_half_confidence,
            with_covariance=False,
        )
        self.counts = counts_of(())
        self.frames = 0

    def run(self) -> dict[str, Any]:
        """Show and write frame by frame until the source, the user or the limit ends it."""
        layout = ClipLayout({}, panels=False)
        recent: deque[float] = deque(maxlen=RATE_OVER)
        start = time.monotonic()
        with ExitStack() as stack:
            lines = stack.enter_context((self.folder / "hands.jsonl").open("w", encoding="utf-8"))
            video = self._video(stack)
            window = open_window(f"hand_recon: {self.source.name}")
            if window is not None:
                stack.callback(window.close)
            fitted = stack.enter_context(closing(ahead(self._fitted(), size=1)))
            try:
                for frame, hands in fitted:
                    recent.append(time.monotonic())
                    self._write(lines, hands)
                    if window is not None or video is not None:
                        caption = f"{_rate(recent):.0f} frames per second"
                        faces = self.hand.faces.numpy()
                        drawing = draw_clip_frame(frame.pixels, hands.drawn, faces, layout, caption)
                        if video is not None:
                            video.write(drawing, frame.time)
                        if window is not None and not window.show(drawing):
                            break
                    if self.options.limit is not None and frame.time >= self.options.limit:
                        break
            except KeyboardInterrupt:
                logger.info("Ended by Ctrl-C.")
        seconds = time.monotonic() - start
        return {
            "frames": self.frames,
            **self.counts,
            "seconds": {"all": round(seconds, 2)},
            "frames_per_second": round(self.frames / max(seconds, 1e-9), 2),
            "shape": self.live.fit.shape.tolist(),
        }

    def _video(self, stack: ExitStack) -> VideoWriter | None:
        if self.options.video is None:
            return None
        path = self.folder / f"video.{self.options.video}"
        return stack.enter_context(VideoWriter(path, fps=self.source.rate_hint))

    def _found(self) -> Iterator[tuple[Frame, FoundFrame]]:
        state = TrackerState()
        for frame in self.source:
            found = self.finding.of_frame(frame, state)
            state = found.state
            yield frame, found

    def _fitted(self) -> Iterator[tuple[Frame, FrameOfHands]]:
        name = self.source.name
        with closing(ahead(self._found(), size=1)) as found:
            for frame, hands in found:
                posed = frames_of_hands(self.live(hands, name), self.poses, [frame.number])
                yield frame, next(posed)

    def _write(self, lines: TextIO, hands: FrameOfHands) -> None:
        self.frames += 1
        self.counts.update(counts_of(hands.entries))
        write_lines(lines, hands.entries)
        lines.flush()


def _rate(times: deque[float]) -> float:
    """Frames per second over some times of frames."""
    return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 0.0
