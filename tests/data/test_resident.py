"""Samples kept in memory give the batches that the dataset gives, and nothing waits for their device."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from hand_recon.data import resident
from hand_recon.data.annotated_dataset import AnnotatedImages, ImageRecipe
from hand_recon.data.appearance import Appearance
from hand_recon.data.augment import Augmentation
from hand_recon.data.crop import CropPolicy
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.dataset import HandDataset, load_batch
from hand_recon.data.resident import ResidentDataset
from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.schema import HandBatch, HandSample, collate
from tests.support.annotated_images import annotated
from tests.support.batch_recorder import BatchRecorder, trainer
from tests.support.numbered_hands import NumberedHands

CPU = torch.device("cpu")
META = torch.device("meta")
"""A device whose values cannot be read: whatever waits for one is an error."""

OPTIONAL: dict[str, Any] = {
    "intrinsics": torch.eye(3),
    "landmarks_3d": torch.ones(21, 3),
    "vertices": torch.ones(5, 3),
    "occluded": torch.ones(21, dtype=torch.bool),
    "label_noise": torch.ones(21),
    "confidence": torch.ones(21),
    "mirrored": True,
}
"""Fields that a sample may lack, with a value."""


class Unlike(NumberedHands):
    """Hands each of which has some of the optional fields."""

    def __init__(self, present: list[list[str]]) -> None:
        super().__init__(len(present), with_3d=False)
        self.present = present
        self.read: list[int] = []

    def __getitem__(self, index: int) -> HandSample:
        self.read.append(index)
        return replace(super().__getitem__(index), **{n: OPTIONAL[n] for n in self.present[index]})


class Together(Unlike):
    """The same hands in batches that the dataset makes itself, as shards do."""

    def batch(self, indices: list[int], /) -> HandBatch:
        return collate([self[index] for index in indices])


def kept(dataset: HandDataset, device: torch.device = CPU) -> ResidentDataset:
    return ResidentDataset(dataset, device, "hands")


def assert_same(first: HandBatch, second: HandBatch) -> None:
    for field in fields(HandBatch):
        left, right = (getattr(batch, field.name) for batch in (first, second))
        if isinstance(left, Tensor):
            torch.testing.assert_close(right, left, rtol=0, atol=0, equal_nan=True, msg=field.name)
        else:
            assert left == right, field.name


@given(
    st.lists(st.lists(st.sampled_from(sorted(OPTIONAL)), unique=True), min_size=1, max_size=6),
    st.data(),
)
@settings(max_examples=60, deadline=None)
def test_any_batch_is_what_collate_makes_of_its_samples(
    present: list[list[str]], data: st.DataObject
) -> None:
    chosen = data.draw(st.lists(st.integers(0, len(present) - 1), min_size=1, max_size=8))
    for dataset in (Unlike(present), Together(present)):
        assert_same(load_batch(dataset, chosen), kept(dataset).batch(chosen))


def test_each_sample_is_read_once_whatever_the_size_of_the_pieces(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(resident, "_AT_ONCE", 3)
    dataset = Unlike([["vertices"], [], ["mirrored"], [], ["intrinsics"], [], []])
    memory = kept(dataset)
    assert sorted(dataset.read) == [0, 1, 2, 3, 4, 5, 6]
    for chosen in ([0, 4], [6, 6, 2], list(range(7))):
        read = len(dataset.read)
        batch = memory.batch(chosen)
        assert len(dataset.read) == read
        assert_same(load_batch(dataset, chosen), batch)


def test_a_batch_is_a_copy_that_may_be_changed() -> None:
    memory = kept(NumberedHands(3))
    memory.batch([1, 2]).image.zero_()
    assert memory.batch([2]).image.sum().item() == 2 * 768


def test_images_of_files_come_mirrored_and_damaged_ones_are_replaced(tmp_path: Path) -> None:
    hands = annotated(tmp_path)
    dataset = AnnotatedImages(hands, None, ImageRecipe(CropPolicy(size=32, around="joints")))
    assert_same(load_batch(dataset, [2, 0, 1]), kept(dataset).batch([2, 0, 1]))
    (tmp_path / "a.png").write_bytes(b"no image")
    memory = kept(dataset)
    assert memory.batch([0]).index.tolist() == [1]
    assert_same(load_batch(dataset, [0, 2]), memory.batch([0, 2]))


def test_rendered_hands_have_their_surfaces(tmp_path: Path) -> None:
    dataset = SyntheticHands("val", 5, 32, "easy", cache_dir=tmp_path)
    batch, expected = kept(dataset).batch([4, 0, 0]), dataset.batch([4, 0, 0])
    # Surfaces are posed when they are read: a hand's last digits depend on the others beside it.
    torch.testing.assert_close(batch.vertices, expected.vertices, rtol=0, atol=1e-6)
    assert_same(replace(expected, vertices=None), replace(batch, vertices=None))


def data_module(keep: str, **arguments: Any) -> HandDataModule:  # noqa: ANN401
    return HandDataModule(
        lambda: NumberedHands(20),
        lambda: NumberedHands(5),
        lambda: NumberedHands(6),
        crop_size=16,
        batch_size=4,
        keep=keep,
        **arguments,
    )


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("keep", ["memory", "device"])
def test_a_training_sees_the_same_batches_wherever_they_are_kept(keep: str) -> None:
    runs = []
    for place in ("disk", keep):
        module, data = BatchRecorder(), data_module(place, augmentation=Augmentation(), workers=2)
        data.workers = 2 if place == keep else 0
        run = trainer(epochs=2)
        run.fit(module, datamodule=data)
        run.test(module, datamodule=data, verbose=False)
        runs.append(module.seen)
        if place == keep:
            # There is nothing to load in other processes.
            assert data.train_dataloader().num_workers == data.val_dataloader().num_workers == 0
            assert data.test_dataloader().num_workers == 2
    for split, number in {"train": 10, "val": 4, "test": 2}.items():
        assert len(runs[0][split]) == len(runs[1][split]) == number
        for first, second in zip(runs[0][split], runs[1][split], strict=True):
            assert_same(first, second)


def test_samples_are_read_once_for_all_loaders() -> None:
    data = data_module("memory")
    loaders = [data.train_dataloader() for _ in range(2)]
    assert loaders[0].dataset.dataset is loaders[1].dataset.dataset  # type: ignore[attr-defined]


def test_batches_are_picked_and_augmented_where_no_value_can_be_read() -> None:
    """Reading a value of the device would stop the processor until the device has done all its work."""
    batch = kept(Unlike([["intrinsics", "landmarks_3d", "label_noise"]] * 6), META).batch([3, 1])
    assert all(
        value.device == META
        for field in fields(batch)
        if isinstance(value := getattr(batch, field.name), Tensor)
    )
    everything = Augmentation(
        side_jitter=0.2, flip=0.5,
        appearance=Appearance(outside=1, grey=1, blur=1, patches=1),
    )  # fmt: skip
    moved = everything(batch, torch.Generator().manual_seed(0))
    assert moved.image.device == META
    assert moved.image.shape == (2, 3, 16, 16)


def test_an_unknown_place_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"Found data.keep=ram; expected one of disk \(read anew"):
        data_module("ram")


def test_more_than_the_free_memory_is_refused_with_the_numbers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # 768 bytes of image, 168 + 21 of labels, 252 of 3D and 8 of the index.
    monkeypatch.setattr(resident, "free_memory", lambda device: int(2 * 1217 / 0.8) + 1)
    assert len(kept(NumberedHands(2))) == 2
    with pytest.raises(MemoryError, match=r"memory of cpu, in each of 2 processes, and"):
        ResidentDataset(NumberedHands(2), CPU, "hands", processes=2)
    # Each process has a GPU of its own.
    assert len(ResidentDataset(NumberedHands(2), META, "hands", processes=2)) == 2
    monkeypatch.setattr(resident, "free_memory", lambda device: 2000)
    with pytest.raises(MemoryError, match=r"2 samples of hands take .* in the memory of cpu, and"):
        kept(NumberedHands(2))
    with pytest.raises(
        MemoryError, match=r"Set data.keep=disk, or data.keep=memory, a smaller crop_size"
    ):
        kept(NumberedHands(2), META)
    monkeypatch.setattr(resident, "free_memory", lambda device: None)
    assert len(kept(NumberedHands(2))) == 2
