"""Fixture of the tests of `predict`."""

from pathlib import Path

import pytest

from hand_recon.hand.model import HandModel
from tests.support.photo_folder import photo_folder


@pytest.fixture
def folder(hand: HandModel, tmp_path: Path) -> Path:
    """Four photographs and the landmarks in them."""
    return photo_folder(hand, tmp_path)
