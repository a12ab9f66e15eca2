"""Show hands in a local web page: a photograph, landmarks or the webcam, and the knowledge step by step.

hand-recon demo                                  # then open http://127.0.0.1:8765/
hand-recon demo outputs/clip                     # play a video's result of hand-recon predict
hand-recon demo port=9000 bounds.megabytes=50
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("demo", __doc__ or "", words)


if __name__ == "__main__":
    main()
