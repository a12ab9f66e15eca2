"""Fixtures of tests of `hand_recon.scale`."""

import gc
from collections.abc import Iterator
from pathlib import Path

import pytest

from hand_recon.hand.model import HandModel
from tests.support.photo_folder import photo_folder


@pytest.fixture
def processes() -> Iterator[None]:
    """Close the pipes of workers that have ended before the next test."""
    yield
    gc.collect()


@pytest.fixture(scope="module")
def folder(hand: HandModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four photographs and the landmarks in them."""
    return photo_folder(hand, tmp_path_factory.mktemp("photos"))
