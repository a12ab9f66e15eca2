"""Test a checkpoint on its own test hands or on another dataset's (Sec. 4.1).

hand-recon evaluate outputs/train/<time>
hand-recon evaluate <run> data=freihand data.root=/path/to/FreiHAND_pub_v2
hand-recon evaluate <run> data=freihand data.root=… protocol=freihand
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("evaluate", __doc__ or "", words)


if __name__ == "__main__":
    main()
