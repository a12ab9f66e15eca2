"""Means of losses that a checkpoint in the middle of an epoch keeps."""

import pytest

from hand_recon.training.epoch_losses import EpochLosses


def test_a_checkpoint_of_an_earlier_version_is_refused_with_its_cure() -> None:
    with pytest.raises(ValueError, match=r"earlier version.*without resume="):
        EpochLosses().load_state_dict({"sums": {}, "hands": 0})
