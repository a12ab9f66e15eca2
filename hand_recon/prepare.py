"""Prepare what is licensed, slow or doubtful: MANO, caches, labels.

hand-recon prepare mano mano_v1_2.zip [folder=data/mano]
hand-recon prepare cache data=freihand data.root=/path/to/FreiHAND_pub_v2
hand-recon prepare check data=freihand data.root=/path/to/FreiHAND_pub_v2
"""

import sys
from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    words = list(sys.argv[1:] if words is None else words)
    # Converting MANO is no run: it leaves no folder of its own behind.
    mano = not {"mano", "task=mano", "--task=mano"}.isdisjoint(words)
    run_verb("prepare", __doc__ or "", words, config_name="prepare_mano" if mano else None)


if __name__ == "__main__":
    main()
