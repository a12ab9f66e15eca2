import logging
import math
from pathlib import Path
from typing import Any

import pytest
import torch
from hydra.utils import instantiate

# Also for the resolvers that it registers.
from hand_recon.command_line.composing import composed
from hand_recon.data.augment import Augmentation
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.dataset import HandDataset
from hand_recon.data.freihand.datamodule import FreiHandDataModule
from hand_recon.data.sample_order import SeededShuffle
from hand_recon.data.synthetic.datamodule import SyntheticDataModule
from hand_recon.schema import HandBatch
from tests.support.batch_recorder import BatchRecorder, trainer
from tests.support.freihand_folder import write_folder
from tests.support.numbered_hands import NumberedHands


def make(train: int = 20, **arguments: Any) -> HandDataModule:  # noqa: ANN401
    return HandDataModule(
        lambda: NumberedHands(train),
        lambda: NumberedHands(5),
        lambda: NumberedHands(6),
        crop_size=16,
        **arguments,
    )


def numbers(batches: list[HandBatch]) -> list[int]:
    return torch.cat([batch.index for batch in batches]).tolist()


@pytest.mark.filterwarnings("ignore")
def test_an_epoch_shows_every_training_hand_once_in_a_new_order() -> None:
    module = BatchRecorder()
    trainer(epochs=2).fit(module, datamodule=make(batch_size=4))
    first, second = numbers(module.seen["train"][:5]), numbers(module.seen["train"][5:])
    assert sorted(first) == sorted(second) == list(range(20))
    assert first != second
    assert numbers(module.seen["val"][:2]) == list(range(5))


@pytest.mark.filterwarnings("ignore")
def test_only_training_is_augmented_and_all_images_are_floats() -> None:
    module, data = BatchRecorder(), make(batch_size=4, augmentation=Augmentation(colour=0.2))
    run = trainer()
    run.fit(module, datamodule=data)
    run.test(module, datamodule=data, verbose=False)
    for split in ("val", "test"):
        for batch in module.seen[split]:
            assert torch.equal(batch.image[:, 0, 8, 8] * 255, batch.index.float())
    assert all(batch.image.dtype == torch.float32 for batch in module.seen["train"])
    moved = torch.cat(
        [batch.image[:, 0, 8, 8] * 255 - batch.index for batch in module.seen["train"]]
    )
    assert (moved.abs() > 1e-3).sum() > 10


@pytest.mark.filterwarnings("ignore")
def test_two_runs_with_one_seed_see_the_same_images() -> None:
    runs: list[torch.Tensor] = []
    for seed in (1, 1, 2):
        module = BatchRecorder()
        torch.manual_seed(len(runs))
        trainer().fit(module, datamodule=make(batch_size=4, augmentation=Augmentation(), seed=seed))
        runs.append(torch.cat([batch.image for batch in module.seen["train"]]))
    assert torch.equal(runs[0], runs[1])
    assert not torch.equal(runs[0], runs[2])


def test_the_order_of_an_epoch_depends_on_seed_and_epoch_alone() -> None:
    shuffle = SeededShuffle(NumberedHands(50), seed=3)
    first = list(shuffle)
    shuffle.set_epoch(1)
    assert list(shuffle) != first
    shuffle.set_epoch(0)
    assert list(shuffle) == first
    assert sorted(first) == list(range(50))


@pytest.mark.filterwarnings("ignore")
def test_worker_processes_give_the_same_batches() -> None:
    direct = [batch.index for batch in make(batch_size=4).train_dataloader()]
    worked = [batch.index for batch in make(batch_size=4, workers=2).train_dataloader()]
    assert torch.equal(torch.stack(direct), torch.stack(worked))


def test_fewer_samples_than_a_batch_are_one_smaller_batch_aloud(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING):
        batches = list(make(train=3, batch_size=64).train_dataloader())
    assert [len(batch) for batch in batches] == [3]
    assert "3 training samples, fewer than batch_size=64" in caplog.text


def test_an_odd_batch_at_the_end_is_dropped_in_training_only() -> None:
    data = make(train=10, batch_size=4)
    assert [len(batch) for batch in data.train_dataloader()] == [4, 4]
    assert [len(batch) for batch in data.test_dataloader()] == [4, 2]


def test_an_empty_split_is_refused() -> None:
    with pytest.raises(ValueError, match="train split of hands is empty"):
        make(train=0).setup("fit")
    with pytest.raises(ValueError, match="batch_size=0 must be at least 1"):
        make(batch_size=0)


@pytest.mark.parametrize(
    ("stage", "expected"),
    [
        ("fit", ["train", "val"]),
        ("validate", ["val"]),
        ("test", ["test"]),
        (None, ["train", "val", "test"]),
    ],
)
def test_a_stage_builds_what_it_needs_once(stage: str | None, expected: list[str]) -> None:
    built: list[str] = []

    def factory(split: str) -> HandDataset:
        built.append(split)
        return NumberedHands(4)

    data = HandDataModule(
        lambda: factory("train"), lambda: factory("val"), lambda: factory("test"), crop_size=16
    )
    data.setup(stage)
    data.setup(stage)
    assert built == expected


def test_ground_truth_is_spread_over_the_training_set() -> None:
    ground_truth = make(train=20).train_ground_truth(limit=4)
    assert ground_truth is not None
    assert ground_truth[0][:, 0, 0].tolist() == [0, 5, 10, 15]
    assert ground_truth[1] is None
    bare = HandDataModule(
        lambda: NumberedHands(4, with_3d=False),
        lambda: NumberedHands(1),
        lambda: NumberedHands(1),
        crop_size=16,
    )
    assert bare.train_ground_truth() is None


@pytest.mark.filterwarnings("ignore")
def test_a_freihand_folder_trains_validates_and_tests(tmp_path: Path) -> None:
    root = write_folder(tmp_path / "hands", hands=20).root
    data = FreiHandDataModule(
        root,
        crop=CropPolicy(32, "joints"),
        reading=ReadingPolicy(tmp_path / "cache"),
        batch_size=8,
        augmentation=Augmentation(),
    )
    module, run = BatchRecorder(), trainer()
    run.fit(module, datamodule=data)
    run.test(module, datamodule=data, verbose=False)
    assert len(numbers(module.seen["train"])) == 64
    assert module.seen["train"][0].image.shape == (8, 3, 32, 32)
    assert module.seen["test"][0].landmarks_3d is not None
    assert data.landmark_set == "mano"
    ground_truth = data.train_ground_truth(10)
    assert ground_truth is not None
    assert ground_truth[0].shape == (10, 21, 3)


def test_an_unknown_option_of_freihand_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="colour"):
        FreiHandDataModule(tmp_path, colour="red")


def test_synthetic_hands_come_with_surfaces_for_evaluation(tmp_path: Path) -> None:
    data = SyntheticDataModule(
        "easy",
        train_size=6,
        val_size=2,
        test_size=2,
        crop_size=48,
        cache_dir=tmp_path,
        batch_size=3,
    )
    batches = list(data.train_dataloader())
    assert [len(batch) for batch in batches] == [3, 3]
    assert batches[0].vertices is None
    assert next(iter(data.test_dataloader())).vertices is not None
    ground_truth = data.train_ground_truth(4)
    assert ground_truth is not None
    assert ground_truth[1] is not None
    assert ground_truth[1].shape[:1] == (4,)


def test_features_are_left_out_of_training_images_alone(tmp_path: Path) -> None:
    sizes = ["data.train_size=2", "data.val_size=2", "data.test_size=2", "crop_size=32"]
    config = composed(
        "train", ["data=synthetic", *sizes, "data.without=[nails]", f"paths.cache='{tmp_path}'"]
    )
    data = instantiate(config.data)
    levels = {split: data.dataset(split).recipe.level.name for split in ("train", "val", "test")}
    assert levels == {"train": "easy-no-nails", "val": "easy", "test": "easy"}
    assert data.ground_truth_dataset().recipe.level.name == "easy-no-nails"


def test_the_number_of_photographs_is_that_of_the_data() -> None:
    words = ["recipe=photos", "photos.train=labels.json", "photos.train_size=700"]
    assert composed("train", words).data.parts.photographs.train_size == 700
    assert composed("train", words[:2]).data.parts.photographs.train_size is None


@pytest.mark.parametrize("overrides", [["data=synthetic"], ["data=freihand", "data.root=hands"]])
def test_the_configuration_builds_a_datamodule(overrides: list[str], tmp_path: Path) -> None:
    config = composed("train", [*overrides, f"paths.cache='{tmp_path}'"])
    data = instantiate(config.data)
    assert isinstance(data, HandDataModule)
    assert data.crop_size == config.crop_size
    assert data.batch_size == config.data.batch_size
    assert data.augmentation is not None
    assert math.isclose(data.augmentation.rotation, config.data.augmentation.rotation)
