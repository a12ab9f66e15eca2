"""Measures the verdicts on fitted hands: false alarms on good hands, and mistakes that are caught.

    python tools/measure_verdicts.py                         # synthetic views of the level medium
    python tools/measure_verdicts.py --level hard
    python tools/measure_verdicts.py --landmarks labels.json # a spread of the hands of a file

Every mistake of `tools/landmark_mistakes.py` is made on the same hands, and fitted; those of cameras on
synthetic hands in images of 640×480 pixels. The table has a row for each mistake: percent of the hands that
are doubtful or not fitted, then percent by reason. Decision 59 has the numbers for the limits in use.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from hand_recon.camera import project
from hand_recon.command_line.composing import composed
from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.fitting.in_parts import Fitter, fit_in_parts
from hand_recon.fitting.verdict import PLAUSIBLE, doubts, verdicts
from hand_recon.runs.configuration import build_hand
from hand_recon.runs.fit_run import adapted_to_data
from hand_recon.runs.fitters import build_fitter
from hand_recon.schema import HandBatch
from landmark_mistakes import IMAGE_SIZE, OF_CAMERAS, OF_LANDMARKS

OUTLIER_NOISE = 9.0
"""Standard deviation of a label's noise from which on a synthetic hand is no good one, pixels of 224."""


def synthetic_views(level: str, count: int, cache: Path) -> HandBatch:
    """Views of test hands, with labels as noisy as the level says."""
    views = SyntheticHands(
        "test", count, 224, level, cache_dir=cache, pictures=False, with_vertices=False
    )
    return views.batch(list(range(count)))


def without_outliers(batch: HandBatch) -> HandBatch:
    """The hands whose labels have less noise than `OUTLIER_NOISE`: an outlier is a mistake by itself."""
    if batch.label_noise is None:
        return batch
    noise = batch.label_noise.masked_fill(~batch.labelled, 0.0).amax(dim=1)
    return batch.select(noise < OUTLIER_NOISE)


def landmarks_of(batch: HandBatch) -> ImageLandmarks:
    """Labels of synthetic views, with confidences and cameras."""
    count = len(batch)
    return ImageLandmarks(
        landmarks_2d=batch.landmarks_2d.double(),
        labelled=batch.labelled,
        left=torch.zeros(count, dtype=torch.bool),
        names=tuple(str(number) for number in range(count)),
        confidence=None if batch.confidence is None else batch.confidence.double(),
        intrinsics=None if batch.intrinsics is None else batch.intrinsics.double(),
    )


def in_images(batch: HandBatch, random: np.random.Generator) -> ImageLandmarks:
    """The hands of views at random places in images of `IMAGE_SIZE`, 0.3 to 1.2 m from one known camera.

    Labels have noise of 2 % of the hand's extent.
    """
    if batch.landmarks_3d is None:
        raise ValueError("Found views without 3D landmarks; expected those of synthetic hands.")
    count = len(batch)
    camera = torch.tensor([[600.0, 0, 322], [0, 600, 239], [0, 0, 1]], dtype=torch.float64)
    pixel = torch.from_numpy(random.uniform(0.25, 0.75, (count, 2))) * torch.tensor(IMAGE_SIZE)
    depth = torch.from_numpy(random.uniform(0.3, 1.2, count))
    ray = (pixel - camera[:2, 2]) / 600
    place = torch.cat([ray, torch.ones(count, 1)], dim=1) * depth[:, None]
    points = batch.landmarks_3d.double()
    points = points - points.mean(dim=1, keepdim=True) + place[:, None]
    seen = project(points, camera.expand(count, 3, 3))
    extent = (seen.amax(dim=1) - seen.amin(dim=1)).amax(dim=-1)
    noise = 0.02 * extent[:, None, None] * torch.from_numpy(random.normal(size=seen.shape))
    return ImageLandmarks(
        landmarks_2d=seen + noise,
        labelled=torch.ones(count, 21, dtype=torch.bool),
        left=torch.zeros(count, dtype=torch.bool),
        names=tuple(str(number) for number in range(count)),
        intrinsics=camera.expand(count, 3, 3).clone(),
    )


def spread(hands: ImageLandmarks, count: int) -> ImageLandmarks:
    """At most `count` hands, evenly spread."""
    chosen = torch.linspace(0, len(hands) - 1, min(count, len(hands))).round().long()
    return hands.select(chosen.unique())


def print_row(
    name: str, hands: ImageLandmarks, fitter: Fitter, size: tuple[int, int] | None = None
) -> None:
    """Fit the hands, judge them, and print the percentages."""
    wrong = 0
    counts: dict[str, int] = {}
    for part in fit_in_parts(hands, fitter):
        sizes = [size] * len(part)
        wrong += sum(verdict.value != PLAUSIBLE for verdict in verdicts(part, sizes))
        for reason, found in doubts(part, sizes).items():
            count = sum(bool(part.fitted[hand]) for hand in found)
            counts[reason] = counts.get(reason, 0) + count
    percent = 100 / len(hands)
    reasons = ", ".join(
        f"{reason} {percent * count:.1f}" for reason, count in counts.items() if count
    )
    print(f"{name:24s} {len(hands):5d} {percent * wrong:6.1f}   {reasons}", flush=True)


def main() -> None:
    """Fit good hands and hands with every mistake, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--landmarks", type=Path, help="file of landmarks in place of synthetic hands"
    )
    parser.add_argument("--level", default="medium", help="level of the synthetic views")
    parser.add_argument("--good", type=int, default=300, help="number of good hands")
    parser.add_argument("--wrong", type=int, default=100, help="number of hands for each mistake")
    parser.add_argument("--cache", type=Path, default=Path(".cache/hand_recon"))
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    config = adapted_to_data(composed("fit", []))
    fitter = build_fitter(config, build_hand(config))
    print(f"{'':24s} {'hands':>5s} {'found':>6s}   by reason, percent")
    if arguments.landmarks is None:
        batch = without_outliers(synthetic_views(arguments.level, arguments.good, arguments.cache))
        good, placed = landmarks_of(batch), in_images(batch, np.random.default_rng(5))
        print_row("good, in images", placed, fitter, IMAGE_SIZE)
        for name, make in OF_CAMERAS.items():
            few = spread(placed, arguments.wrong)
            print_row(name, make(few, np.random.default_rng(3)), fitter, IMAGE_SIZE)
    else:
        good = spread(read_landmarks(arguments.landmarks), arguments.good)
    print_row("good", good, fitter)
    for name, make in OF_LANDMARKS.items():
        print_row(name, make(spread(good, arguments.wrong), np.random.default_rng(3)), fitter)


if __name__ == "__main__":
    main()
