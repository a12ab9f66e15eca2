"""Show finished runs as the paper's Tables 1 to 3, with intervals (Sec. 4.2, 4.3, 5).

hand-recon report
hand-recon report outputs/sweeps/<time>
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("report", __doc__ or "", words)


if __name__ == "__main__":
    main()
