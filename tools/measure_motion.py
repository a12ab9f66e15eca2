"""Measures motion: minima chosen frame by frame and over time, and smoothing, on clips with ground truth.

    python tools/measure_motion.py --headset <handy> --stereo <clip> --slow <clip>

`<handy>` holds the poses of a living hand of stewdio/handy.js (MIT), which made-up clips go through;
`--stereo` a clip of one hand by two cameras (`tools/depth/stereo.py` has its form); `--slow` a clip of a hand
that hardly moves (`tools/motion/clips.py`). Every clip is fitted frame by frame with one shape. The table has
PA-MPJPE (E_J), accelerations, jitter in the image and processor times, for the least cost of each frame
alone, for minima chosen over time (`hand_recon/motion/choice.py`), and for these smoothed with each strength
as a whole and live.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

import torch

from depth.methods import Method
from hand_recon.runs.results import write_json
from motion.clips import MotionClip, landmark_clip, made_up_clip, two_camera_clip
from motion.fits import fitted_clip, motions
from motion.scores import markdown, outside_of_ranges, scores_of, scores_of_truth

NOISES: Final = ((1.0, 0.0), (1.0, 0.7), (3.0, 0.0), (3.0, 0.7))
"""Standard deviation of the landmarks, pixels, and correlation between frames, of the made-up clips."""


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    add = parser.add_argument
    add("--headset", type=Path, help="folder of poses_left.json and poses_right.json")
    add("--stereo", type=Path, help="folder of calibration.json and landmarks.npz")
    add("--slow", type=Path, help="folder of frames.json, K.json and truth.npy")
    add("--seeds", type=int, nargs="+", default=[1, 2], help="seeds of the made-up clips")
    add("--seconds", type=float, nargs="+", default=[0, 0.03, 0.06, 0.1, 0.2], help="strengths")
    add("--method", default="default=", help="NAME=override,override of conf/fit.yaml")
    add("--json", type=Path, help="file for all numbers")
    return parser.parse_args(words)


def _clips(arguments: argparse.Namespace) -> Iterator[MotionClip]:
    """The clips that were asked for; made-up ones of odd seeds are right hands."""
    if arguments.stereo is not None:
        yield two_camera_clip(arguments.stereo)
    if arguments.slow is not None:
        yield landmark_clip(arguments.slow)
    if arguments.headset is not None:
        for seed in arguments.seeds:
            side = "right" if seed % 2 else "left"
            for noise, correlation in NOISES:
                yield made_up_clip(
                    arguments.headset, side=side, seed=seed, noise=noise, correlation=correlation
                )


def main(words: Sequence[str] | None = None) -> None:
    """Fit every clip, print the table and write what was asked for.

    Args:
        words: The command line; none for this process's own.
    """
    arguments = _arguments(words)
    torch.set_num_threads(1)
    method = Method.parsed(arguments.method)
    rows = []
    outside: dict[str, float] = {}
    for clip in _clips(arguments):
        rows.append((clip.name, "ground truth", scores_of_truth(clip)))
        fitted = fitted_clip(clip, method)
        for motion in motions(fitted, arguments.seconds):
            rows.append((clip.name, motion.name, scores_of(fitted, motion)))
            degrees = outside_of_ranges(motion.trajectory.joint_angles)
            outside[motion.name] = max(degrees, outside.get(motion.name, 0.0))
    print(markdown(rows))
    largest = ", ".join(f"{name} {degrees:.2f}°" for name, degrees in outside.items())
    print(f"\nLargest violation of a range of motion: {largest}.")
    if arguments.json is not None:
        entries = [{"clip": clip, "motion": name, **asdict(scores)} for clip, name, scores in rows]
        write_json(arguments.json, {"runs": entries})


if __name__ == "__main__":
    main()
