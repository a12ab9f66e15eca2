"""Audit hand poses of any origin: ranges of motion, functional anatomy, penetration, bones (Sec. 3.2).

hand-recon audit outputs/my_hands/hands.json
hand-recon audit pred.json ranges=paper_release strict=true
hand-recon audit poses_left.json poses_right.json same_person=true repair=true output=outputs/headset
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("audit", __doc__ or "", words)


if __name__ == "__main__":
    main()
