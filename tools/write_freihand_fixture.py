"""Write synthetic hands in FreiHAND's layout: `python tools/write_freihand_fixture.py ROOT --unique 64`."""

import argparse
from pathlib import Path

from hand_recon.hand.mano.layer import ManoLayer
from hand_recon.rehearsal.freihand import FreiHandFolder, write_freihand_layout


def main() -> None:
    """Write the folder that the arguments describe."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path, help="folder to write; must not hold training images")
    parser.add_argument("--unique", type=int, default=64, help="training hands, four images each")
    parser.add_argument("--evaluation", type=int, default=32, help="evaluation images")
    parser.add_argument("--without-vertices", action="store_true", help="leave *_verts.json out")
    parser.add_argument(
        "--mano",
        type=Path,
        help="folder of MANO's hands, for training_mano.json; else the open hand",
    )
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    folder = FreiHandFolder(
        unique=arguments.unique,
        evaluation=arguments.evaluation,
        with_vertices=not arguments.without_vertices,
        mano=None
        if arguments.mano is None
        else ManoLayer.load(arguments.mano, landmark_set="mano"),
        seed=arguments.seed,
    )
    write_freihand_layout(arguments.root, folder)


if __name__ == "__main__":
    main()
