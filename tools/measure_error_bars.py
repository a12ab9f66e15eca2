"""Measures 3D error bars on known hands, and fits their correction.

    python tools/measure_error_bars.py --headset <handy> --stereo <clip>             # the shipped corrections
    python tools/measure_error_bars.py --headset <handy> --fit --write table.json    # fits them again

`<handy>` and `<clip>` are those of `tools/measure_depth.py`. Corrections are fitted on half a of the
headset's poses (`living`) and on validation views of synthetic hands (`synthetic`), with two noises or with
and without a camera. The table is of what they have not seen: half b, the clip by two cameras, and test
views, whose gestures and shapes are others. Errors are from the hand's origin, as `covariance_3d` in a
file of hands is.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import torch

from depth.sets import DepthSet, headset_poses, synthetic_views
from depth.stereo import stereo_clip
from error_bars.correction import fit_correction
from error_bars.errors import Errors
from error_bars.tables import markdown
from hand_recon import __version__
from hand_recon.formats.new_file import refuse_existing, write_new
from hand_recon.uncertainty.covariance_correction import (
    LAPLACE,
    CovarianceCorrection,
    correction_named,
)

NOISES: Final = (3.0, 4.8)
"""Noises of the headset's landmarks, pixels: as the fit takes it to be, and that of a detector."""

EARLIER: Final = CovarianceCorrection(
    scale=torch.full((21,), 1.5),
    across=torch.full((21,), 0.0045),
    depth=torch.full((21,), 0.0045),
    factors=torch.ones(21, 3),
)
"""Correction of decision 65: 1.5 times Laplace's σ, and 4.5 mm along every axis."""


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    add = parser.add_argument
    add("--headset", type=Path, help="folder of poses_left.json and poses_right.json")
    add("--stereo", type=Path, help="folder of calibration.json and landmarks.npz")
    add(
        "--hands",
        type=int,
        default=600,
        help="validation views; half as many test views; 0 for none",
    )
    add("--every", type=int, default=4, help="step between frames of the clip")
    add("--seeds", type=int, nargs="+", default=[0, 1], help="seeds of the headset's cameras")
    add("--fit", action="store_true", help="fit corrections in place of the shipped ones")
    add("--write", type=Path, help="new file for the fitted corrections")
    add("--cache", type=Path, default=Path("outputs/cache"), help="folder of the synthetic views")
    return parser.parse_args(words)


def _views(arguments: argparse.Namespace, split: str, count: int) -> list[Errors]:
    """Synthetic views with their cameras, and the same without."""
    sets = [
        synthetic_views(count, arguments.cache, camera=camera, split=split)
        for camera in (True, False)
    ]
    return [Errors.of(one) for one in sets]


def _headset(arguments: argparse.Namespace, half: str) -> list[Errors]:
    """Poses of a living hand with each of `NOISES`."""
    return [
        Errors.of(_named(headset_poses(arguments.headset, seeds=arguments.seeds, noise=noise, half=half),
                         f"headset {half}, {noise:g} px"))
        for noise in NOISES
    ]  # fmt: skip


def _named(hands: DepthSet, name: str) -> DepthSet:
    return DepthSet(
        name, hands.landmarks, hands.ground_truth, hands.groups, hands.second, hands.landmark_set
    )


def _fitted(arguments: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Entries of the table of corrections."""
    sources: dict[str, list[Errors]] = {}
    if arguments.headset is not None:
        sources["living"] = _headset(arguments, "a")
    if arguments.hands:
        sources["synthetic"] = _views(arguments, "val", arguments.hands)
    return {
        name: {
            "measured_on": [
                {"set": one.name, "hands": len(one), "groups": len(set(one.groups))} for one in sets
            ],
            "groups": fit_correction(sets),
        }
        for name, sets in sources.items()
    }


def _held_out(arguments: argparse.Namespace) -> list[Errors]:
    """Sets that no correction was fitted on."""
    sets: list[Errors] = []
    if arguments.headset is not None:
        sets += _headset(arguments, "b")
    if arguments.stereo is not None:
        sets.append(Errors.of(stereo_clip(arguments.stereo, every=arguments.every)))
    if arguments.hands:
        sets += _views(arguments, "test", max(1, arguments.hands // 2))
    return sets


def main(words: Sequence[str] | None = None) -> None:
    """Fit or read the corrections, print the table, and write what was asked for.

    Args:
        words: The command line; none for this process's own.
    """
    arguments = _arguments(words)
    torch.set_num_threads(1)
    if arguments.write is not None and not arguments.fit:
        raise SystemExit("--write writes corrections that --fit has fitted; give both.")
    if arguments.write is not None:
        # Before minutes of fits.
        refuse_existing([arguments.write])
    corrections: dict[str, CovarianceCorrection | None] = {LAPLACE: None, "decision 65": EARLIER}
    if arguments.fit:
        fitted = _fitted(arguments)
        corrections |= {
            name: CovarianceCorrection.of_groups(one["groups"]) for name, one in fitted.items()
        }
        if arguments.write is not None:
            command = "python tools/measure_error_bars.py --headset <handy> --fit --write <file>"
            table = {"command": command, "version": __version__, "corrections": fitted}
            write_new(arguments.write, (json.dumps(table, indent=1) + "\n").encode())
    else:
        corrections |= {name: correction_named(name) for name in ("synthetic", "living")}
    print(markdown(_held_out(arguments), corrections))


if __name__ == "__main__":
    main()
