"""Score anybody's file of predictions as its benchmark does, and check it for mistakes (Sec. 4.1).

hand-recon score pred.json protocol=freihand ground_truth=/path/to/folder
hand-recon score pred.zip protocol=ho3d_v3 ground_truth=/path/to/folder --output scores.json
hand-recon score results.txt protocol=dexycb data=dexycb data.root=/path/to/DexYCB
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("score", __doc__ or "", words)


if __name__ == "__main__":
    main()
