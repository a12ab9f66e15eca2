"""Write synthetic hands in DexYCB's layout: `python tools/write_dexycb_fixture.py ROOT --every 19`."""

import argparse
from pathlib import Path

from hand_recon.data.dexycb.files import SUBJECTS
from hand_recon.data.dexycb.surfaces import load_pair
from hand_recon.rehearsal.dexycb import DexYcbFolder, write_dexycb_layout


def main() -> None:
    """Write the folder that the arguments describe."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path, help="folder to write; must be empty")
    parser.add_argument(
        "--subjects", type=int, default=len(SUBJECTS), help="how many, from the first"
    )
    parser.add_argument("--frames", type=int, default=1, help="frames of each camera")
    parser.add_argument("--every", type=int, default=19, help="every n-th sequence has frames")
    parser.add_argument("--mano", type=Path, help="folder of MANO's hands; else the open hand")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    folder = DexYcbFolder(
        subjects=tuple(range(arguments.subjects)),
        frames=arguments.frames,
        every=arguments.every,
        mano=None if arguments.mano is None else load_pair(arguments.mano, left_hands=True),
        seed=arguments.seed,
    )
    write_dexycb_layout(arguments.root, folder)


if __name__ == "__main__":
    main()
