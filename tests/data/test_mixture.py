"""Mixtures: share of each dataset, an order that can be resumed, and the fields of a mixed batch."""

import logging
from collections import Counter
from pathlib import Path
from typing import Any

import lightning
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from lightning.fabric.utilities.distributed import DistributedSamplerWrapper

from hand_recon.camera import default_intrinsics
from hand_recon.data.augment import Augmentation
from hand_recon.data.crop import CropPolicy
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.freihand.datamodule import FreiHandDataModule
from hand_recon.data.landmarks.datamodule import LandmarkDataModule
from hand_recon.data.mixture import MixedHands, MixtureDataModule, WeightedShuffle, shares
from hand_recon.schema import HandBatch
from tests.support.batch_recorder import BatchRecorder, trainer
from tests.support.dotted_images import Dotted
from tests.support.freihand_folder import write_folder
from tests.support.numbered_hands import NumberedHands

SIZE = 16


def numbered(count: int, with_3d: bool = True, size: int = SIZE) -> HandDataModule:
    return HandDataModule(
        lambda: NumberedHands(count, with_3d), lambda: NumberedHands(5), lambda: NumberedHands(6),
        crop_size=size, batch_size=3, augmentation=Augmentation(),
    )  # fmt: skip


def mixture(**arguments: Any) -> MixtureDataModule:  # noqa: ANN401
    parts = {"many": numbered(80), "few": numbered(20, with_3d=False)}
    return MixtureDataModule(parts, **arguments)


def order(data: MixtureDataModule, epoch: int = 0) -> list[int]:
    sampler = data.train_dataloader().sampler
    assert isinstance(sampler, WeightedShuffle)
    sampler.set_epoch(epoch)
    return list(sampler)


# --- share of each dataset ------------------------------------------------------------------------


def test_without_weights_every_hand_comes_once() -> None:
    data = mixture()
    assert data.counts() == {"many": 80, "few": 20}
    assert sorted(order(data)) == list(range(100))


def test_weights_are_shares_of_an_epoch_and_a_small_part_comes_again() -> None:
    data = mixture(weights={"many": 1.0, "few": 3.0})
    assert data.counts() == {"many": 25, "few": 75}
    counted = Counter(order(data))
    few = [counted[index] for index in range(80, 100)]
    # 75 of 20 hands: each three times, and 15 of them once more.
    assert sorted(few) == [3] * 5 + [4] * 15
    # 25 of 80: no hand twice, and others in another epoch.
    assert all(counted[index] <= 1 for index in range(80))
    other = Counter(order(data, epoch=1))
    assert {index for index in range(80) if counted[index]} != {i for i in range(80) if other[i]}


def test_any_stretch_of_an_epoch_is_mixed_within_binomial_bounds() -> None:
    """The datasets are interleaved: four σ of a binomial for each tenth of an epoch."""
    sampler = WeightedShuffle([3000, 500], shares([0.7, 0.3], 2000), seed=1)
    drawn = torch.tensor(list(sampler))
    assert len(drawn) == len(sampler) == 2000
    assert int((drawn >= 3000).sum()) == 600
    for stretch in drawn.split(200):
        share = float((stretch >= 3000).float().mean())
        assert abs(share - 0.3) < 4 * (0.3 * 0.7 / 200) ** 0.5


def test_an_epoch_can_have_any_length_and_a_part_no_share() -> None:
    data = mixture(epoch_size=10, weights={"many": 0.0, "few": 2.0}, batch_size=5)
    assert data.counts() == {"many": 0, "few": 10}
    assert all(index >= 80 for index in order(data))
    assert [len(batch) for batch in data.train_dataloader()] == [5, 5]


@given(st.lists(st.floats(0, 9), min_size=1, max_size=6), st.integers(1, 5000))
def test_shares_are_whole_near_their_weight_and_sum_to_the_epoch(
    weights: list[float], total: int
) -> None:
    weights = [*weights, 1.0]
    counts = shares(weights, total)
    assert sum(counts) == total
    for count, weight in zip(counts, weights, strict=True):
        assert abs(count - weight * total / sum(weights)) < 1 + 1e-6


# --- order -----------------------------------------------------------------------------


def test_the_order_follows_from_seed_and_epoch_alone() -> None:
    first = mixture(weights={"many": 1.0, "few": 1.0}, seed=3)
    torch.manual_seed(1)
    resumed = mixture(weights={"many": 1.0, "few": 1.0}, seed=3)
    order(first)
    assert order(resumed, epoch=2) == order(first, epoch=2)
    assert order(first, epoch=1) != order(first, epoch=2)
    assert order(first) != order(mixture(weights={"many": 1.0, "few": 1.0}, seed=4))


def test_processes_share_an_epoch_and_follow_its_number() -> None:
    """Two processes, as under Lightning: each takes every second sample of the same order."""
    whole = order(mixture(seed=5), epoch=1)
    dealt = []
    for rank in range(2):
        sampler = mixture(seed=5).train_dataloader().sampler
        wrapped = DistributedSamplerWrapper(sampler, num_replicas=2, rank=rank, shuffle=False)
        wrapped.set_epoch(1)
        dealt.append(list(wrapped))
    assert [hand for pair in zip(*dealt, strict=True) for hand in pair] == whole


@pytest.mark.filterwarnings("ignore")
def test_a_resumed_run_sees_the_epochs_that_it_would_have_seen(tmp_path: Path) -> None:
    def run(epochs: int, checkpoint: Path | None = None) -> tuple[list[int], lightning.Trainer]:
        module, runner = BatchRecorder(), trainer(epochs)
        runner.fit(module, datamodule=mixture(batch_size=10, epoch_size=40), ckpt_path=checkpoint)
        return torch.cat([batch.index for batch in module.seen["train"]]).tolist(), runner

    whole, _ = run(2)
    first, runner = run(1)
    runner.save_checkpoint(tmp_path / "last.ckpt")
    second, _ = run(2, tmp_path / "last.ckpt")
    assert first + second == whole
    assert first != second


# --- fields of a batch -------------------------------------------------------------------------


def test_hands_have_numbers_of_their_own_and_the_name_of_their_dataset() -> None:
    hands = MixedHands({"many": NumberedHands(80), "few": NumberedHands(20)})
    assert [hands[index].index for index in range(100)] == list(range(100))
    assert (hands[79].source, hands[80].source) == ("many: number 79", "few: number 0")
    with pytest.raises(IndexError, match="Sample 100 of 100"):
        hands[100]


def test_hands_without_3d_have_an_unknown_one_even_in_a_batch_of_their_own() -> None:
    few = MixedHands({"many": NumberedHands(4), "few": NumberedHands(4, with_3d=False)})[5]
    assert few.landmarks_3d is not None
    assert few.landmarks_3d.isnan().all()
    assert MixedHands({"few": NumberedHands(4, with_3d=False)})[1].landmarks_3d is None


def real_parts(folder: Path) -> dict[str, HandDataModule]:
    crop = CropPolicy(32, "joints")
    freihand = write_folder(folder / "freihand", hands=8).root
    path = Dotted(folder / "wild", images=8).as_coco()
    return {
        "freihand": FreiHandDataModule(freihand, crop=crop, landmark_set="knuckle"),
        "wild": LandmarkDataModule(path, crop=crop),
    }


@pytest.mark.filterwarnings("ignore")
def test_a_mixed_batch_keeps_the_cameras_that_are_known_and_assumes_the_others(
    tmp_path: Path,
) -> None:
    parts = real_parts(tmp_path)
    data = MixtureDataModule(parts, weights={"freihand": 1.0, "wild": 1.0}, batch_size=8)
    known = parts["freihand"].dataset("train")
    assumed = default_intrinsics(32, torch.zeros(1))
    seen = Counter[str]()
    for batch in data.train_dataloader():
        assert isinstance(batch, HandBatch)
        assert batch.intrinsics is not None
        assert batch.landmarks_3d is not None
        assert batch.vertices is None
        for position, source in enumerate(batch.source):
            name = source.split(":")[0]
            seen[name] += 1
            if name == "freihand":
                ground_truth = known[int(batch.index[position])].intrinsics
                assert ground_truth is not None
                torch.testing.assert_close(batch.intrinsics[position], ground_truth)
                assert batch.landmarks_3d[position].isfinite().all()
            else:
                assert torch.equal(batch.intrinsics[position], assumed)
                assert batch.landmarks_3d[position].isnan().all()
    # 6 × 4 images of FreiHAND and 12 hands of the other: batches of 8 leave 4 of an epoch out.
    assert min(seen.values()) >= 14
    assert seen.total() == 32


@pytest.mark.filterwarnings("ignore")
def test_one_part_is_scored_the_first_if_none_is_named(tmp_path: Path) -> None:
    parts = real_parts(tmp_path)
    first = MixtureDataModule(parts, batch_size=4)
    assert (first.name, len(first.dataset("test"))) == (
        "freihand",
        len(parts["freihand"].dataset("test")),
    )
    assert next(iter(first.test_dataloader())).landmarks_3d is not None
    ground_truth = first.train_ground_truth(5)
    assert ground_truth is not None
    assert ground_truth[0].shape == (5, 21, 3)
    wild = MixtureDataModule(parts, score_on="wild", batch_size=4)
    assert (wild.name, wild.landmark_set) == ("landmarks", "knuckle")
    assert wild.dataset("val") is parts["wild"].dataset("val")
    assert next(iter(wild.val_dataloader())).landmarks_3d is None
    assert wild.train_ground_truth(5) is None
    assert wild.train_parameters(5) is None


# --- the mixture's own settings, and errors ---------------------------------------------------


@pytest.mark.filterwarnings("ignore")
def test_batches_and_augmentation_are_the_mixtures() -> None:
    module = BatchRecorder()
    trainer().fit(module, datamodule=mixture(batch_size=25))
    assert [len(batch) for batch in module.seen["train"]] == [25] * 4
    for batch in module.seen["train"]:
        # The parts would be augmented: here, each image still is its own number.
        own = torch.where(batch.index < 80, batch.index, batch.index - 80)
        assert torch.equal((batch.image[:, 0, 8, 8] * 255).round().long(), own)
    augmented = BatchRecorder()
    trainer().fit(augmented, datamodule=mixture(batch_size=25, augmentation=Augmentation()))
    assert not torch.equal(augmented.seen["train"][0].image, module.seen["train"][0].image)


def test_an_epoch_shorter_than_a_batch_is_a_smaller_batch_aloud(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING):
        batches = list(mixture(epoch_size=7, batch_size=64).train_dataloader())
    assert [len(batch) for batch in batches] == [7]
    assert "has 7 training samples, fewer than batch_size=64" in caplog.text


def test_parts_with_another_landmark_set_are_named(caplog: pytest.LogCaptureFixture) -> None:
    parts = {"one": numbered(4), "two": numbered(4)}
    parts["two"].landmark_set = "mano"
    assert MixtureDataModule(parts).landmark_set == "knuckle"
    assert "The labels of two follow the landmark set mano" in caplog.text
    caplog.clear()
    assert MixtureDataModule(parts, landmark_set="mano").landmark_set == "mano"
    assert "The labels of one follow the landmark set knuckle" in caplog.text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"score_on": "all"}, r"score_on=all is not one of the parts \['few', 'many'\]"),
        ({"weights": {"many": 1.0}}, r"weights for \['many'\] and parts \['few', 'many'\]"),
        ({"weights": {"many": 1.0, "few": -1.0}}, "must not be negative"),
        ({"weights": {"many": 0.0, "few": 0.0}}, "one must be positive"),
        ({"epoch_size": 0}, "epoch_size=0 must be at least 1"),
        ({"batch_size": 0}, "batch_size=0 must be at least 1"),
    ],
)
def test_what_is_no_mixture_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        mixture(**arguments)


def test_crops_of_two_sizes_and_no_parts_are_refused() -> None:
    with pytest.raises(ValueError, match=r"crops differ in size, \{'one': 16, 'two': 32\}"):
        MixtureDataModule({"one": numbered(4), "two": numbered(4, size=32)})
    with pytest.raises(ValueError, match="A mixture needs parts"):
        MixtureDataModule({})
