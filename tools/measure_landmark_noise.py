"""Measure σ of MediaPipe's landmarks, and write the table of it that the detector reads (decision 68).

    python -m tools.measure_landmark_noise table <folder> --only rps digits --count 1600 --write
    python -m tools.measure_landmark_noise check <folder> --labels test.json --only rps digits --count 400
    python -m tools.measure_landmark_noise calibrate <clip> --write
    python -m tools.measure_landmark_noise fit <clip>

`<folder>` holds images and lists of them (`[{"image": …}, …]`); the table is fitted to the spread of
transformed copies of each hand's crop. `<clip>` holds a hand filmed by two calibrated cameras
(`calibration.json`, `cam0.mp4`, `cam1.mp4`); σ is scaled to the distance from the epipolar constraint, and
hands are fitted with one σ and with each landmark's own. For the fits, `landmarks.npz` has the triangulated
`points`.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from hand_recon.detection.copies import COPIES
from hand_recon.detection.landmark_noise import TABLE, load_table
from landmark_noise.clip import Calibration, calibrate, rank_correlation, read_clip
from landmark_noise.readings import SQUARE, CopiedHand, Image, read_hands
from landmark_noise.table import fit_table, write_table
from measure_detector import read

SOURCES: Final = ("equal", "table", "copies", "both")


def main() -> None:
    """Run the command that was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=tuple(TASKS))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--labels", default="train.json", help="list of images")
    parser.add_argument("--only", nargs="+", default=[], help="folders of the images to use")
    parser.add_argument("--count", type=int, default=0, help="so many images, spread evenly")
    parser.add_argument("--every", type=int, default=1, help="step between frames of the clip")
    parser.add_argument("--write", action="store_true", help="write the result to the package")
    options = parser.parse_args()
    TASKS[options.task](options)


def make_table(options: argparse.Namespace) -> None:
    """Fit the table to images; its calibration stays as it is."""
    hands = hands_of_images(options)
    table = fit_table(hands, load_table().gain)
    if options.write:
        words = [word for word in sys.argv[1:] if word not in ("--write", str(options.folder))]
        command = (
            f"python -m tools.measure_landmark_noise {words[0]} <folder> {' '.join(words[1:])}"
        )
        write_table(table, TABLE, command.strip())


def check_table(options: argparse.Namespace) -> None:
    """Print how well the table agrees with the spread of copies, and the time of a hand."""
    hands, table = hands_of_images(options), load_table()
    expected = np.array([table.spread(hand.features) for hand in hands])
    measured = np.array([hand.spread(len(COPIES)) for hand in hands])
    within = [rank_correlation(*pair) for pair in zip(expected, measured, strict=True)]
    medians = [SQUARE * float(np.median(values)) for values in (measured, expected)]
    print(
        f"rank correlation {rank_correlation(expected, measured):.3f}, within a hand "
        f"{np.mean(within):.3f}; median spread {medians[0]:.2f} px of {SQUARE}, by the table {medians[1]:.2f}"
    )


def calibrate_table(options: argparse.Namespace) -> None:
    """Print the calibration of every source of σ, and write σ per spread for every number of copies."""
    clip, table = read_clip(options.folder, options.every), load_table()
    print(f"{len(clip.hands[0])} frames")
    gains = []
    for copies in range(len(COPIES) + 1):
        for use in SOURCES:
            if copies or use in ("equal", "table"):
                print(
                    f"{copies} copies, σ from {use}: {_words(calibrate(clip, table, copies, use))}"
                )
        gains.append(calibrate(clip, table, copies).gain)
    if options.write:
        command = TABLE.read_text(encoding="utf-8").splitlines()[1].removeprefix("#").strip()
        write_table(replace(table, gain=np.array(gains)), TABLE, command)


def fit_clip(options: argparse.Namespace) -> None:
    """Print the 3D error of fits with one σ and with each landmark's own."""
    # The fit takes a second to import.
    from landmark_noise.clip_fits import compare

    for line in compare(read_clip(options.folder, options.every), options.folder, load_table()):
        print(line)


def _words(found: Calibration) -> str:
    return (
        f"gain {found.gain:.2f}, rms {found.rms:.2f} px of {SQUARE}, within 1σ {found.within[0]:.3f}, "
        f"2σ {found.within[1]:.3f}, −log likelihood {found.likelihood:.3f}, rank correlation "
        f"{found.correlation:.3f}, within a hand {found.correlation_in_hand:.3f}"
    )


def hands_of_images(options: argparse.Namespace) -> list[CopiedHand]:
    """Read the hands of some images of a folder."""
    rows = json.loads((options.folder / options.labels).read_text(encoding="utf-8"))
    groups = [
        [row["image"] for row in rows if not only or row["image"].startswith(f"{only}/")]
        for only in options.only or [""]
    ]
    names = [name for group in groups for name in evenly(group, options.count // len(groups))]
    began = time.process_time()
    hands = [hand for hand in read_hands(_images(options.folder, names)) if hand is not None]
    each = 1e3 * (time.process_time() - began) / max(len(names), 1)
    print(
        f"{len(names)} images, {len(hands)} hands, {each:.0f} ms of an image with {len(COPIES)} copies"
    )
    return hands


def evenly(names: list[str], count: int) -> list[str]:
    """So many names, spread evenly over the list; all for 0."""
    count = min(count or len(names), len(names))
    return [names[index * len(names) // count] for index in range(count)]


def _images(folder: Path, names: list[str]) -> Iterator[Image]:
    for name in names:
        yield read(folder / name)


TASKS: Final = {
    "table": make_table,
    "check": check_table,
    "calibrate": calibrate_table,
    "fit": fit_clip,
}
"""Tasks by name."""


if __name__ == "__main__":
    main()
