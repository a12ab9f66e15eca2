"""Write hands as files of other programs: GLB, BVH, USD, OpenSim, OpenXR, MANO and more (docs/export.md).

hand-recon export outputs/my_hands/hands.json
hand-recon export hands.json format=glb,bvh,openxr --output my_files
hand-recon export hands.json format=mano hand=mano
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("export", __doc__ or "", words)


if __name__ == "__main__":
    main()
