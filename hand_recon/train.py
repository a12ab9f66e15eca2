"""Train, test the best checkpoint, print a table, write images and a report (Sec. 3.4, 4).

hand-recon train
hand-recon train data=freihand data.root=/path/to/FreiHAND_pub_v2
hand-recon train -m +experiment=ablation_row1,ablation_row2 seed=0,1,2
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("train", __doc__ or "", words)


if __name__ == "__main__":
    main()
