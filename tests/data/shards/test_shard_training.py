"""Training from shards: the batches of a training from files, every hand once, from any batch on."""

import dataclasses
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from hand_recon.data.crop import CropPolicy
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.dataset import load_batch
from hand_recon.data.landmarks.datamodule import LandmarkDataModule
from hand_recon.data.mixture import MixtureDataModule
from hand_recon.data.shards.dataset import ShardedImages
from hand_recon.runs.building import build_data
from hand_recon.schema import HandBatch
from tests.support.configurations import composed
from tests.support.shard_folders import IMAGES, SIZE, changed_manifest, data_of, shards


def from_files(labels: Path, **options: Any) -> LandmarkDataModule:  # noqa: ANN401
    options = {"crop": CropPolicy(SIZE, "joints"), "batch_size": 4, "seed": 5} | options
    return LandmarkDataModule(labels, **options)


def assert_same(found: HandBatch, expected: HandBatch) -> None:
    """Fail unless every field is the same, bit for bit."""
    for field in dataclasses.fields(HandBatch):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        if isinstance(other, torch.Tensor):
            assert torch.equal(one.nan_to_num(-7.0), other.nan_to_num(-7.0)), field.name
        else:
            assert one == other, field.name


def batches(data: HandDataModule, epoch: int = 0) -> Iterator[HandBatch]:
    loader: Any = data.train_dataloader()
    loader.sampler.set_epoch(epoch)
    return iter(loader)


def test_batches_and_splits_are_those_of_the_files_bit_for_bit(
    labels: Path, shard_folder: Path
) -> None:
    files, sharded = from_files(labels), data_of(shard_folder)
    for split in ("train", "val", "test"):
        expected, found = files.dataset(split), sharded.dataset(split)
        assert len(found) == len(expected)
        every = list(range(len(expected)))
        assert_same(load_batch(found, every), load_batch(expected, every))
    for epoch in range(2):
        for one, other in zip(batches(sharded, epoch), batches(files, epoch), strict=True):
            assert other.label_noise is not None
            assert_same(one, other)


@pytest.mark.parametrize("order", ["all", "shards"])
@pytest.mark.parametrize("workers", [0, 2])
def test_an_epoch_has_every_hand_once(shard_folder: Path, order: str, workers: int) -> None:
    data = data_of(shard_folder, order=order, workers=workers, batch_size=2, shards_at_once=2)
    seen = [index for batch in batches(data) for index in batch.index.tolist()]
    assert Counter(seen) == Counter(range(2 * (IMAGES - 2)))


@pytest.mark.parametrize("order", ["all", "shards"])
def test_a_resumed_epoch_begins_at_its_batch_and_reads_nothing_before(
    shard_folder: Path, order: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = list(batches(data_of(shard_folder, order=order), 3))
    data = data_of(shard_folder, order=order)
    loader: Any = data.train_dataloader()
    loader.load_state_dict({"epoch": 3, "batches": 2})
    loader.sampler.set_epoch(3)
    dataset = data.dataset("train")
    assert isinstance(dataset, ShardedImages)
    read, asked = dataset.rows.read, Counter[int]()

    def counted(rows: list[int]) -> Any:  # noqa: ANN401
        asked.update(rows)
        return read(rows)

    monkeypatch.setattr(dataset.rows, "read", counted)
    rest = list(loader)
    assert len(rest) == len(whole) - 2
    for found, expected in zip(rest, whole[2:], strict=True):
        assert_same(found, expected)
    assert asked.total() == 4 * len(rest)


def test_two_folders_are_one_dataset_and_no_group_is_in_two_splits(
    labels: Path, shard_folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    second = shards(labels, tmp_path / "out", "images_per_shard=2", "max_side=50")
    data = data_of([shard_folder, str(tmp_path / "o*")], val_fraction=0.3)
    every = [data.dataset(split) for split in ("train", "val", "test")]
    assert "held out of 2 folders of shards, whose groups differ" in caplog.text
    assert sum(map(len, every)) == 4 * IMAGES
    groups = []
    for dataset in every:
        assert isinstance(dataset, ShardedImages)
        assert dataset.chosen is not None
        groups.append(set(dataset.rows.groups()[dataset.chosen].tolist()))
    assert len(set.union(*groups)) == sum(map(len, groups)) == 2 * IMAGES
    caplog.clear()
    assert len(data_of([second], val_fraction=0.3).dataset("val")) > 0
    assert len(data_of([second, shard_folder], val=second, test=second).dataset("train")) > 0
    assert "folders of shards" not in caplog.text
    assert len(data_of(second, val=shard_folder, test=shard_folder).dataset("train")) == 2 * IMAGES


def test_a_damaged_image_is_skipped_counted_and_never_zero(
    shard_folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = Path(shutil.copytree(shard_folder, tmp_path / "copy"))
    path = folder / "shard-00000.tar"
    content = bytearray(path.read_bytes())
    first = data_of(folder, val=folder, test=folder).dataset("train")
    assert isinstance(first, ShardedImages)
    middle = int(first.rows.indices[0].row(0)["offset"]) + 1500
    content[middle] ^= 0xFF
    path.write_bytes(content)
    data = data_of(folder, val=folder, test=folder).dataset("train")
    batch = load_batch(data, [0, 1, 2])
    # Both hands of the first image are replaced by the first hand of the second one.
    assert batch.index.tolist() == [2, 2, 2]
    assert_same(batch.select(slice(0, 1)), load_batch(first, [2]))
    assert "Cannot read the hand at byte 512 of shard-00000.tar" in caplog.text
    assert "another checksum than the index" in caplog.text
    assert isinstance(data, ShardedImages)
    assert len(data.corrupt.names) == 1
    with pytest.raises(RuntimeError, match="more than max_corrupt=0"):
        data_of(folder, val=folder, test=folder, max_corrupt=0).dataset("train")[0]


def test_crops_that_the_shards_have_no_boxes_for_are_refused(shard_folder: Path) -> None:
    with pytest.raises(ValueError, match=r"around=joints, and the crops are to be around=box"):
        data_of(shard_folder, crop=CropPolicy(SIZE, "box")).dataset("train")
    assert len(data_of(shard_folder, crop=CropPolicy(SIZE, "full")).dataset("train")) == 14


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"order": "none"}, "Unknown order='none'"), ({"verify": "md5"}, "Unknown verify='md5'"),
        ({"crop": CropPolicy(8, "mask")}, r"Unknown crop.around='mask'"),
        ({"val_fraction": 0.5}, "between 0 and 0.5"), ({"streams": -1}, "streams=-1"),
    ],
)  # fmt: skip
def test_an_unknown_option_names_the_choices(options: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        data_of("nowhere", **options)


def test_a_group_beyond_those_of_the_manifest_is_refused(
    shard_folder: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(shard_folder, tmp_path / "copy"))
    changed_manifest(folder, lambda content: content.update(groups=2))
    with pytest.raises(ValueError, match=r"has the group 3 in an index, .* there are 2 groups"):
        data_of(folder).dataset("train")


def test_shards_are_a_part_of_a_mixture(shard_folder: Path) -> None:
    config = composed(
        "data=mixture", "data@data.parts.landmarks=shards", "data@data.parts.freihand=shards",
        f"data.parts.landmarks.train='{shard_folder}'", f"data.parts.freihand.train='{shard_folder}'",
        "crop_size=48", "data.batch_size=8", "paths.cache=null",
    )  # fmt: skip
    batch = next(batches(build_data(config)))
    assert len(batch) == 8
    assert {name.split(":")[0] for name in batch.source} == {"landmarks", "freihand"}


def test_an_order_of_shards_is_refused_in_a_mixture(shard_folder: Path) -> None:
    parts = {"files": data_of(shard_folder), "web": data_of(shard_folder, order="shards")}
    told = r"part web has order=shards.*Set data.parts.web.order=all, or train on web alone"
    with pytest.raises(ValueError, match=told):
        MixtureDataModule(parts)
    assert len(MixtureDataModule({"files": parts["files"]}).dataset("train")) == 14
