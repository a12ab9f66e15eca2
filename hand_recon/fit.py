"""Fit 3D hands to 2D landmarks with the knowledge and the likelihood of training (Sec. 3.2-3.4).

hand-recon fit hands.json --output outputs/my_hands
hand-recon fit hands.json intrinsics=K.json prior=biomechanics
hand-recon fit data=views +experiment=ablation_row4 lifter=none descent.finger_table=false
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("fit", __doc__ or "", words)


if __name__ == "__main__":
    main()
