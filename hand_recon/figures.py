"""Draw the paper's Fig. 3 and 4 from trained rows of Table 1: what knowledge and the likelihood change.

hand-recon figures
hand-recon figures outputs/sweeps/<time> 'hands=[3,17,40]'
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("figures", __doc__ or "", words)


if __name__ == "__main__":
    main()
