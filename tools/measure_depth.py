"""Measures depth from 2D landmarks alone: methods of the fit on living and synthetic hands.

    python tools/measure_depth.py --headset <handy> --stereo <clip>              # the default fit
    python tools/measure_depth.py --headset <handy> --rows                       # rows 1 to 5 of Table 1
    python tools/measure_depth.py --headset <handy> --method default= --method adam=descent.solver=adam
    python tools/measure_depth.py --headset <handy> --half a --worst 12 --draw worst.png

`<handy>` holds the poses of a living hand of stewdio/handy.js (MIT), `<clip>` a clip of one hand by two
cameras (`tools/depth/stereo.py` has its form). A method is a name and overrides of `conf/fit.yaml`. The table
has PA-MPJPE (E_J) with 95 % bootstrap intervals over groups of hands that are alike (all views of a named
pose, blocks of consecutive frames, single synthetic hands), paired changes against one method, and processor
times on one thread.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import torch

from depth.comparison import PREVIOUS, Scored, as_json, markdown
from depth.coverage import markdown_coverage
from depth.drawing import draw_worst
from depth.failures import markdown_failures
from depth.methods import TABLE_1, Method, run
from depth.sets import DepthSet, headset_poses, synthetic_views
from depth.stereo import stereo_clip
from hand_recon.fitting.results import write_image
from hand_recon.runs.results import write_json


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    add = parser.add_argument
    add("--headset", type=Path, help="folder of poses_left.json and poses_right.json")
    add("--stereo", type=Path, help="folder of calibration.json and landmarks.npz")
    add("--hands", type=int, default=200, help="synthetic hands; 0 for none")
    add("--method", action="append", default=[], help="NAME=override,override; may be repeated")
    add("--rows", action="store_true", help="the five rows of Table 1, before the methods")
    add("--against", help="method that others are compared with, or `previous`; else the first")
    add("--half", choices=("a", "b", "both"), default="both", help="half of the headset's poses")
    add("--seeds", type=int, nargs="+", default=[0], help="seeds of the headset's made-up cameras")
    add("--noise", type=float, default=3.0, help="noise of the headset's landmarks, pixels")
    add("--every", type=int, default=1, help="step between frames of the clip")
    add("--alone", type=int, default=20, help="hands that are also fitted one by one, for the time")
    add("--worst", type=int, default=12, help="hands to draw")
    add("--draw", type=Path, help="PNG of the worst hands of the headset by the last method")
    add("--json", type=Path, help="file for all numbers")
    add("--cache", type=Path, default=Path("outputs/cache"), help="folder of the synthetic views")
    return parser.parse_args(words)


def _sets(arguments: argparse.Namespace) -> list[DepthSet]:
    """The sets that were asked for."""
    sets = []
    if arguments.headset is not None:
        sets.append(
            headset_poses(
                arguments.headset,
                seeds=arguments.seeds,
                noise=arguments.noise,
                half=arguments.half,
            )
        )
    if arguments.stereo is not None:
        sets.append(stereo_clip(arguments.stereo, every=arguments.every))
    if arguments.hands:
        with_camera, without = (
            synthetic_views(arguments.hands, arguments.cache, camera=camera)
            for camera in (True, False)
        )
        sets += [with_camera, without]
    return sets


def _methods(arguments: argparse.Namespace) -> list[Method]:
    """The methods that were asked for; the default fit if none was."""
    rows = [Method(name, row) for name, row in TABLE_1.items()] if arguments.rows else []
    methods = rows + [Method.parsed(text) for text in arguments.method]
    return methods or [Method("default")]


def main(words: Sequence[str] | None = None) -> None:
    """Run every method on every set, print the table and write what was asked for.

    Args:
        words: The command line; none for this process's own.
    """
    arguments = _arguments(words)
    torch.set_num_threads(1)
    methods = _methods(arguments)
    against = arguments.against or methods[0].name
    if against not in [PREVIOUS, *(method.name for method in methods)]:
        raise SystemExit(f"--against {against} is none of the methods; name one of them.")
    scored = [
        Scored.of(hands, run(method, hands, arguments.alone))
        for hands in _sets(arguments)
        for method in methods
    ]
    print(markdown(scored, against))
    covered = markdown_coverage(scored)
    if covered:
        print(f"\n{covered}")
    if arguments.json is not None:
        write_json(arguments.json, as_json(scored, against))
    drawn = [one for one in scored if one.hands.name == "headset"]
    if drawn:
        print(f"\n{markdown_failures(drawn[-1])}")
    if arguments.draw is not None and drawn:
        write_image(arguments.draw, draw_worst(drawn[-1], arguments.worst))


if __name__ == "__main__":
    main()
