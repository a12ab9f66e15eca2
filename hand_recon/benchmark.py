"""Measure speed as ratios to plain versions of the published formulas, on this machine.

hand-recon benchmark                                   # every suite: ten minutes
hand-recon benchmark suite=layer,physics threads=2
hand-recon benchmark suite=step device=cuda baseline=outputs/benchmark/<time>
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("benchmark", __doc__ or "", words)


if __name__ == "__main__":
    main()
