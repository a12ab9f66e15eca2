"""Prepare what is licensed, large, slow or doubtful: MANO, the hand detector, caches, labels, shards.

hand-recon prepare mano mano_v1_2.zip [folder=data/mano]
hand-recon prepare detector [hand_landmarker.task]
hand-recon prepare cache data=freihand data.root=/path/to/FreiHAND_pub_v2
hand-recon prepare check data=freihand data.root=/path/to/FreiHAND_pub_v2
hand-recon prepare labels my_photos [output=my_labels] [export=cvat]
hand-recon prepare shards labels=my_labels/labels.json images=my_photos output=my_shards
"""

import sys
from collections.abc import Sequence
from typing import Final

from hand_recon.command_line.hydra_verb import run_verb

CONFIGURATIONS: Final = {
    "mano": "prepare_mano",
    "detector": "prepare_detector",
    "labels": "prepare_labels",
    "shards": "prepare_shards",
}
"""Tasks that have a configuration of their own."""


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    words = list(sys.argv[1:] if words is None else words)
    given = [word.removeprefix("--").removeprefix("task=") for word in words]
    # The first, because a file may be called like a task.
    own = next((CONFIGURATIONS[word] for word in given if word in CONFIGURATIONS), None)
    run_verb("prepare", __doc__ or "", words, config_name=own)


if __name__ == "__main__":
    main()
