"""Say what this machine has of what hand_recon can use, what is missing, and the next command to type.

hand-recon doctor
hand-recon doctor /path/to/datasets --json
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("doctor", __doc__ or "", words)


if __name__ == "__main__":
    main()
