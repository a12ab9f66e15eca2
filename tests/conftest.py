"""Shared fixtures and settings: one thread, one seed, the open hand, and a reason for each skip."""

import os
from pathlib import Path

import hypothesis
import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand

DATA = Path(os.environ.get("HAND_RECON_DATA", "data"))
"""Folder of the licensed files."""

# The same examples on every machine: a failure elsewhere is a failure here. The first call of a
# shape-checked function is slow, so there is no deadline.
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=50)
hypothesis.settings.load_profile("repeatable")

torch.set_num_threads(1)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests that need a device or files that this machine lacks, with the reason."""
    if item.get_closest_marker("gpu") and not torch.cuda.is_available():
        pytest.skip("needs a CUDA device")
    if item.get_closest_marker("mano") and not (DATA / "mano" / "MANO_RIGHT.pkl").is_file():
        pytest.skip(f"needs MANO_RIGHT.pkl in {DATA / 'mano'} (see data/README.md)")
    for marker in item.iter_markers("dataset"):
        (name,) = marker.args
        if not (DATA / name).is_dir():
            pytest.skip(f"needs the {name} dataset in {DATA / name} (see data/README.md)")


@pytest.fixture(autouse=True)
def _seed() -> None:
    """Seed PyTorch before every test, so that their order does not matter."""
    torch.manual_seed(0)


@pytest.fixture(scope="session")
def hand() -> HandModel:
    """The open hand in single precision; `copy.deepcopy(hand).double()` for gradient checks."""
    return open_hand()
