"""Measures a network for photographs: 2D on held-out people, 3D on a clip by two cameras, by groups.

    python tools/measure_photos.py <run> --labels test.json --images <folder> --clip <clip>

A run is a folder or a checkpoint of `recipe=photos`, or several with their names: `row5=outputs/…`. For
each run there are up to five ways: from pixels alone, from pixels and the labels as a detector's
landmarks, both with the fit behind, and this on a clip as of one person, whose hands share a shape. E_2D
is in pixels of a 224-pixel crop, against the labels, which are a detector's. PA-MPJPE is against the
landmarks that the two cameras triangulate.
"""

import argparse
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

import torch

from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.runs.checkpoints import load_trained
from hand_recon.runs.results import write_json
from photos.drawing import draw_page
from photos.methods import WAYS, methods
from photos.scores import Scored, score
from photos.sets import PhotoSet, clip_photographs, labelled_photographs
from photos.tables import as_json, group_table, main_table


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    add = parser.add_argument
    add("runs", nargs="+", help="runs or checkpoints, or NAME=run")
    add("--labels", type=Path, help="labels of the photographs")
    add("--images", type=Path, help="folder of the photographs; else that of the labels")
    add("--clip", type=Path, help="folder of cam0.mp4, calibration.json and landmarks.npz")
    add("--every", type=int, default=1, help="step between frames of the clip")
    add(
        "--ways",
        nargs="+",
        choices=WAYS,
        metavar="WAY",
        help=f"some of: {', '.join(map(repr, WAYS))}",
    )
    add("--turns", nargs="*", type=float, help="degrees of further looks; none for one look")
    add("--groups", action="store_true", help="tables by folder, gesture, view, lightness")
    add(
        "--unseen",
        nargs="*",
        default=[],
        help="gestures that training did not have, as folder/gesture",
    )
    add("--draw", type=Path, help="PNG of 60 photographs by every run, two views each")
    add("--json", type=Path, help="file for all numbers")
    return parser.parse_args(words)


def main(words: Sequence[str] | None = None) -> None:
    """Score every run in every way on every set, print the tables and write what was asked for.

    Args:
        words: The command line; none for this process's own.
    """
    arguments = _arguments(words)
    scored: list[Scored] = []
    sets = cache(partial(_sets, arguments))
    for text in arguments.runs:
        name, _, path = text.rpartition("=")
        regressor, size = _network(path, arguments.turns)
        for hands in sets(size):
            for way, run in methods(regressor, one_person=hands.one_person).items():
                if arguments.ways and way not in arguments.ways:
                    continue
                label = f"{name}: {way}" if name else way
                scored.append(score(hands, label, run(hands), regressor.hand))
    print(main_table(scored))
    if arguments.groups:
        print("\n" + group_table(scored, arguments.unseen))
    if arguments.json is not None:
        write_json(arguments.json, as_json(scored))
    if arguments.draw is not None:
        draw_page(arguments.draw, scored)


def _network(path: str, turns: Sequence[float] | None) -> tuple[Regressor, int]:
    """The network of a run, and the side of its crops, pixels."""
    trained = load_trained(path)
    regressor = trained.module.regressor
    if turns is not None and isinstance(regressor.encoder, PhotoEncoder):
        regressor.encoder.turns = tuple(turns)
    return regressor, int(trained.config.crop_size)


def _sets(arguments: argparse.Namespace, size: int) -> list[PhotoSet]:
    sets = []
    if arguments.labels is not None:
        images = arguments.images or arguments.labels.parent
        sets.append(labelled_photographs(arguments.labels, images, size, 1.5))
    if arguments.clip is not None:
        sets.append(clip_photographs(arguments.clip, size, 1.5, arguments.every))
    return sets


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
