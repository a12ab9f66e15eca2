"""Drawn images and their shards, made once."""

from pathlib import Path

import pytest

from tests.support.shard_folders import labelled_images, shards


@pytest.fixture(scope="session")
def labels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File of the landmarks of nine images, in their folder."""
    return labelled_images(tmp_path_factory.mktemp("images"))


@pytest.fixture(scope="session")
def shard_folder(labels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three shards of these images, which no test changes."""
    return shards(labels, tmp_path_factory.mktemp("shards") / "out")
