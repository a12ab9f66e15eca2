"""Write synthetic hands in HO3D's layout: `python tools/write_ho3d_fixture.py ROOT --frames 16`."""

import argparse
from pathlib import Path

from hand_recon.rehearsal.ho3d import Ho3dFolder, write_ho3d_layout


def main() -> None:
    """Write the folder that the arguments describe."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path, help="folder to write; must not hold training images")
    parser.add_argument("--version", choices=("v3", "v2"), default="v3", help="of the layout")
    parser.add_argument("--frames", type=int, default=16, help="annotated frames of each sequence")
    parser.add_argument(
        "--without-ground-truth", action="store_true", help="leave evaluation_*.json out"
    )
    parser.add_argument("--without-vertices", action="store_true", help="leave surfaces out")
    parser.add_argument(
        "--size", type=int, nargs=2, default=(640, 480), help="width and height, pixels"
    )
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    width, height = arguments.size
    folder = Ho3dFolder(
        version=arguments.version,
        frames=arguments.frames,
        evaluation_frames=arguments.frames,
        with_ground_truth=not arguments.without_ground_truth,
        with_vertices=not arguments.without_vertices,
        size=(width, height),
        seed=arguments.seed,
    )
    write_ho3d_layout(arguments.root, folder)


if __name__ == "__main__":
    main()
