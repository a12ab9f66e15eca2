"""Search settings of a training by Optuna, scored on the validation hands (decision 95).

hand-recon search recipe=lifter search=learning_rate search.trials=20
hand-recon search recipe=lifter search=knowledge search.objective=val/E_J search.n_jobs=2
hand-recon search recipe=lifter folder=outputs/searches/<time>      # goes on with an interrupted search
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("search", __doc__ or "", words)


if __name__ == "__main__":
    main()
