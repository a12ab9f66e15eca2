"""Reconstructs the hands of a video: finds and follows them, fits, smooths and draws (Sec. 3.2-3.4)."""

import logging
import shutil
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from rich.table import Table

from hand_recon.data.progress import with_progress
from hand_recon.data.video.frames import FrameSource, VideoError
from hand_recon.fitting.photo_camera import parse_camera
from hand_recon.hand.model import HandModel
from hand_recon.motion.identity import Identities, identify
from hand_recon.motion.identity_settings import IdentitySettings
from hand_recon.motion.identity_steps import FrameHands
from hand_recon.runs.clip.checks import check_clip
from hand_recon.runs.clip.drawing import draw_video, layout_of
from hand_recon.runs.clip.finding import Finding, follower, looker
from hand_recon.runs.clip.fitting import fit_clip
from hand_recon.runs.clip.found_frames import FoundFrame
from hand_recon.runs.clip.hands_of_clip import hands_of_clip
from hand_recon.runs.clip.motion_of_hands import HandMotion, motion_of
from hand_recon.runs.clip.options import MotionOptions
from hand_recon.runs.clip.results import (
    FrameOfHands,
    clip_products,
    counts_of,
    frames_of_hands,
    write_motions,
    writing_frames,
)
from hand_recon.runs.clip.smoothed import ClipPoses, SmoothedHand
from hand_recon.runs.clip.steadiness import steadiness
from hand_recon.runs.configuration import build_hand, instantiate, plain
from hand_recon.runs.fit_run import source_of
from hand_recon.runs.fitters import build_objective
from hand_recon.runs.looking import build_detector, steps_before
from hand_recon.runs.photo_checkpoint import checkpoint_file, with_network
from hand_recon.runs.photo_network import PhotoNetwork
from hand_recon.runs.results import write_json
from hand_recon.runs.unfinished import (
    claim_or_resume,
    file_state,
    finish,
    results_folder,
    settings_of,
)

logger = logging.getLogger(__name__)

MOST_SAID: Final = 5
"""Hands that are left out, each of which is said."""

LEAST_AGREEMENT: Final = 0.9
"""Share of the frames in which a hand has its side, below which a warning says so."""

_FILES: Final = ("camera", "detector.landmarks", "detector.boxes", "lifter", "hand.path")


def predict_clip(config: DictConfig, source: FrameSource, word: str) -> dict[str, Any]:
    """Reconstruct the hands of a video file or a sequence of images.

    Args:
        config: `conf/predict.yaml` composed and adapted.
        source: The frames.
        word: Word of the command line that named them.

    Returns:
        Numbers of frames, hands, hands in frames, and frames per second.

    Raises:
        ValueError: The video cannot be read, has no hand, or an option is not for videos.
    """
    config, network = with_network(config)
    check_clip(config)
    folder = results_folder(config)
    settings = settings_of(config, _FILES)
    settings["video"] = [file_state(path) for path in source.files or (Path(word),)]
    # Results do not depend on it.
    del settings["options"]["motion"]["processes"]
    if config.ckpt is not None:
        settings["files"]["ckpt"] = file_state(checkpoint_file(config.ckpt))
    claim_or_resume(folder, clip_products(folder), settings)
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    logger.info("Reconstructing the hands of %s into %s", source.name, folder)
    run = _ClipRun(config, source, folder, network)
    summary = run.all()
    finish(folder)
    shutil.rmtree(run.unfinished)
    _report(folder, summary)
    return summary


class _ClipRun:
    """The stages of a clip; each goes on where an interrupted command left it."""

    def __init__(
        self, config: DictConfig, source: FrameSource, folder: Path, network: PhotoNetwork | None
    ) -> None:
        self.config, self.source, self.folder, self.network = config, source, folder, network
        self.options: MotionOptions = instantiate(config.motion)
        self.unfinished = folder / "unfinished"
        self.unfinished.mkdir(exist_ok=True)
        self.choice = parse_camera(str(config.camera), 1)
        self.hand: HandModel = build_hand(config)
        self.objective = build_objective(config, self.hand)
        self.seconds: dict[str, float] = {}

    def all(self) -> dict[str, Any]:
        """Run all stages, and sum up."""
        detector = build_detector(self.config)
        with self._timed("find"):
            look = None if self.network is None else looker(self.network, self.choice)
            follow = follower(detector, self.options.palms_every, self.options.copies)
            finding = Finding(self.source, follow, look)
            frames = finding.into(self.unfinished / "frames.jsonl")
        if not frames:
            raise VideoError(f"{self.source.name} has no frame. Give another video.")
        identities = self._identities(frames)
        origin = source_of(self.config, self.hand, steps_before(detector, self.network))
        hands = hands_of_clip(
            frames,
            identities.tracks,
            self.choice,
            name=Path(self.source.name).name,
            origin=origin,
        )
        motions: list[HandMotion] = []
        smoothed: list[SmoothedHand] = []
        with self._timed("fit"):
            fits = fit_clip(self.config, hands, self.unfinished, self.options.processes)
            for hand, shape, estimates in fits:
                if not np.isfinite(estimates.cost).any():
                    logger.warning(
                        "Hand %d is left out: no frame of it was fitted.", hand.track.number
                    )
                    continue
                motion = motion_of(hand.track, shape, estimates, frames, self.options)
                motions.append(motion)
                smoothed.append(SmoothedHand(hand, motion.smooth))
        if not motions:
            raise ValueError(f"No hand of {self.source.name} was fitted. Look at its frames.")
        return self._written(frames, identities, motions, smoothed)

    def _identities(self, frames: Sequence[FoundFrame]) -> Identities:
        """Hands that keep number and side over the clip.

        Raises:
            ValueError: There is none.
        """
        seen = [FrameHands(one.number, one.time, one.hands) for one in frames]
        found = identify(seen, IdentitySettings(longest_gap=self.options.longest_gap))
        _say_doubts(found)
        if not found.tracks and found.dropped:
            raise ValueError(
                f"No hand of {self.source.name} is left: each is taken for a false detection, for the "
                "reasons above. Give a longer clip, or take its frames as photographs."
            )
        if not found.tracks:
            raise ValueError(
                f"No hand was found in the {len(frames)} frames of {self.source.name}. A hand that is there "
                "may be too small, cut off or blurred; detector.min_palm_score=0.3 looks less strictly."
            )
        return found

    def _written(
        self,
        frames: Sequence[FoundFrame],
        identities: Identities,
        motions: Sequence[HandMotion],
        hands: Sequence[SmoothedHand],
    ) -> dict[str, Any]:
        """Write everything, and sum up."""
        paths = [motion.smooth for motion in motions]
        with self._timed("write"):
            entries = self._entries(frames, hands)
            write_motions(self.folder, paths, self.hand, self.options, frames[-1].time)
        if self.options.video is not None:
            with self._timed("draw"):
                draw_video(
                    self.folder / f"video.{self.options.video}",
                    self.source,
                    self._hands_of(frames, hands, drawn=True),
                    self.hand.faces.numpy(),
                    layout_of(paths, panels=self.options.panels),
                    threads=self.options.processes,
                )
        intrinsics = hands[0].hand.landmarks.intrinsics
        if intrinsics is None:
            raise AssertionError
        summary = {
            "frames": len(frames),
            "tracks": len(paths),
            **entries,
            "dropped": list(identities.dropped),
            "seconds": {name: round(value, 2) for name, value in self.seconds.items()},
            "jitter": steadiness(motions, self.hand, intrinsics[0].double().numpy()),
        }
        write_json(self.folder / "clip.json", summary)
        return summary

    def _entries(self, frames: Sequence[FoundFrame], hands: Sequence[SmoothedHand]) -> Counter[str]:
        """Write the file of hands."""
        total: Counter[str] = Counter()
        with writing_frames(self.folder, sum(len(hand.motion) for hand in hands)) as write:
            for frame in self._hands_of(frames, hands):
                write(frame.entries)
                total.update(counts_of(frame.entries))
        return total

    def _hands_of(
        self, frames: Sequence[FoundFrame], hands: Sequence[SmoothedHand], *, drawn: bool = False
    ) -> Iterator[FrameOfHands]:
        """Hands of every frame, with progress; drawings do not show the covariances of landmarks."""
        poses = ClipPoses(
            self.objective,
            instantiate(self.config.descent),
            self.config.sigma_at_half_confidence,
            with_covariance=not drawn,
        )
        posed = frames_of_hands(hands, poses, [frame.number for frame in frames])
        task = f"{'Drawing' if drawn else 'Writing'} the hands of {self.source.name}, frames"
        return with_progress(posed, len(frames), task)

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[stage] = time.perf_counter() - start


def _say_doubts(found: Identities) -> None:
    """Say which hands were left out, and which may be two that were mixed up."""
    for sentence in found.dropped[:MOST_SAID]:
        logger.info("%s", sentence)
    if len(found.dropped) > MOST_SAID:
        logger.info("%d more hands are left out, for such reasons.", len(found.dropped) - MOST_SAID)
    for track in found.tracks:
        if track.agreement < LEAST_AGREEMENT:
            logger.warning(
                "Hand %d is taken for a %s one, as in %.0f %% of its frames; in the others it was found to "
                "be of the other side. Two hands may have been mixed up there.",
                track.number, track.side, 100 * track.agreement,
            )  # fmt: skip


def _report(folder: Path, summary: dict[str, Any]) -> None:
    """Print the numbers, on standard error."""
    table = Table(title=str(folder), show_header=False)
    table.add_column("what")
    table.add_column("value", justify="right")
    for key, words in _WORDS.items():
        table.add_row(words, str(summary[key]))
    whole = sum(summary["seconds"].values())
    table.add_row("frames per second, all stages", f"{summary['frames'] / max(whole, 1e-9):.1f}")
    for row in summary["jitter"]:
        before, after = row["jitter_before_mm_per_s2"], row["jitter_after_mm_per_s2"]
        if before is not None:
            table.add_row(f"jitter of hand {row['hand']}, mm/s²", f"{before:.0f} → {after:.0f}")
    Console(stderr=True).print(table)


_WORDS: Final = {
    "frames": "frames",
    "tracks": "hands of the clip",
    "fitted": "hands in frames",
    "bridged": "of these, in gaps that were bridged",
    "doubtful": "of these, doubtful with the reasons in the file of hands",
}
