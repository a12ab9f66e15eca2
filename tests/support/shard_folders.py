"""Shards of drawn images, made as the command makes them."""

import json
from pathlib import Path
from typing import Any, Final

from omegaconf import DictConfig

from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.shards.datamodule import ShardDataModule
from hand_recon.runs.shard_run import prepare_shards
from tests.support.configurations import settings
from tests.support.dotted_images import Dotted

IMAGES: Final = 9
"""Images, of two hands each."""

SIZE: Final = 48
"""Side of the crops, pixels."""


def labelled_images(folder: Path) -> Path:
    """Draw images and write a file of their landmarks, with σ and some that are missing; returns the file."""
    dotted = Dotted(folder, IMAGES)
    hands = dotted.objects()
    for number, hand in enumerate(hands):
        hand["sigma"] = [0.5 + number / 7 + landmark / 3 for landmark in range(21)]
        hand["confidence"] = [0.9 - landmark / 30 for landmark in range(21)]
        hand["landmarks"][number % 21] = None
    return dotted.write(hands)


def asked(labels: Path, output: Path, *overrides: str) -> DictConfig:
    """`conf/prepare_shards.yaml` composed for a file of landmarks; four images to a shard."""
    return settings(
        output, output, f"labels='{labels}'", f"output='{output}'", "images_per_shard=4",
        *overrides, name="prepare_shards",
    )  # fmt: skip


def shards(labels: Path, output: Path, *overrides: str) -> Path:
    """Write shards; returns their folder."""
    prepare_shards(asked(labels, output, *overrides))
    return output


def data_of(place: Any, cache: Path | None = None, **options: Any) -> ShardDataModule:  # noqa: ANN401
    """The datamodule of shards at a place, with small crops and batches of four."""
    reading = ReadingPolicy(cache, max_corrupt=options.pop("max_corrupt", 20))
    options = {"crop": CropPolicy(SIZE, "joints"), "batch_size": 4, "seed": 5} | options
    return ShardDataModule(train=place, reading=reading, **options)


def changed_manifest(folder: Path, change: Any) -> None:  # noqa: ANN401  # a function of the manifest
    """Replace the manifest of a folder by a changed one."""
    path = folder / "shards.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
