"""Several datasets as one: training hands drawn with weights, scores on one of the datasets (Sec. 4.1).

An epoch has a fixed number of hands of each dataset, in an order that follows from the seed and the epoch
alone. No hand is repeated in an epoch before all hands of its dataset have been drawn.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import DataLoader

from hand_recon.camera import default_intrinsics
from hand_recon.data.augment import Augmentation
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.dataset import HandDataset
from hand_recon.data.sample_order import EpochSampler
from hand_recon.data.selection import evenly_spaced
from hand_recon.schema import HandParameters, HandSample

logger = logging.getLogger(__name__)


class MixedHands:
    """Concatenation of several datasets whose samples all have the same fields.

    A batch has a field only if all of its samples have it. So hands without a camera get the default camera
    (`docs/conventions.md`, camera), and hands without 3D ground truth get NaN if another dataset has it.
    Surfaces are left out: they are for evaluation only, and their vertices differ between datasets.
    """

    def __init__(self, parts: Mapping[str, HandDataset]) -> None:
        """Store the datasets and check one sample of each for 3D ground truth.

        Args:
            parts: Datasets by name.
        """
        self.parts = dict(parts)
        self.sizes = [len(part) for part in self.parts.values()]
        self.starts = [sum(self.sizes[:number]) for number in range(len(self.sizes))]
        self.has_3d = any(part[0].landmarks_3d is not None for part in self.parts.values())

    def __len__(self) -> int:
        return sum(self.sizes)

    def __getitem__(self, index: int) -> HandSample:
        """The sample at a position; its source begins with its dataset's name.

        Raises:
            IndexError: There is no such position.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"Sample {index} of {len(self)}.")
        number = max(number for number, start in enumerate(self.starts) if start <= index)
        name, start = list(self.parts)[number], self.starts[number]
        sample = self.parts[name][index - start]
        # A damaged image is replaced by another sample, whose index is returned.
        sample = replace(
            sample,
            index=start + sample.index,
            source=f"{name}: {sample.source}",
            vertices=None,
        )
        return self._completed(sample)

    def _completed(self, sample: HandSample) -> HandSample:
        if sample.intrinsics is None:
            # A sample without an image (size 0) gets no camera.
            size = sample.image.shape[-1]
            if size:
                camera = default_intrinsics(size, sample.landmarks_2d)
                sample = replace(sample, intrinsics=camera)
        if self.has_3d and sample.landmarks_3d is None:
            sample = replace(sample, landmarks_3d=torch.full((21, 3), torch.nan))
        return sample


class WeightedShuffle(EpochSampler):
    """Sampler of a fixed number of hands of each part, in an order that depends only on seed and epoch."""

    def __init__(self, sizes: Sequence[int], counts: Sequence[int], seed: int) -> None:
        """Store the sizes and counts.

        Args:
            sizes: Number of hands of each part, in order of concatenation.
            counts: Number of hands of each part in an epoch; a part with fewer hands repeats some.
            seed: Seed of the order.
        """
        super().__init__(seed)
        self.sizes = tuple(sizes)
        self.counts = tuple(counts)

    def order(self) -> list[int]:
        """Indices into the concatenation of the parts."""
        generator = self.generator()
        drawn, start = [], 0
        for size, count in zip(self.sizes, self.counts, strict=True):
            rounds = -(-count // size)
            orders = [torch.randperm(size, generator=generator) for _ in range(rounds)]
            drawn += [start + torch.cat(orders)[:count]] if rounds else []
            start += size
        every = torch.cat(drawn)
        return list(every[torch.randperm(len(every), generator=generator)].tolist())

    def __len__(self) -> int:
        return sum(self.counts)


def shares(weights: Sequence[float], total: int) -> list[int]:
    """Integers in proportion to the weights, with the given sum (largest remainder method).

    Args:
        weights: Not negative, at least one positive.
        total: Sum of the integers.
    """
    exact = [weight * total / sum(weights) for weight in weights]
    counts = [int(value) for value in exact]
    by_remainder = sorted(range(len(exact)), key=lambda number: counts[number] - exact[number])
    for number in by_remainder[: total - sum(counts)]:
        counts[number] += 1
    return counts


class MixtureDataModule(HandDataModule):
    """Trains on several datasets at once, validates and tests on one of them.

    Batch size, loading processes, order and augmentation are the mixture's; those of its parts are not used.
    """

    def __init__(
        self,
        parts: Mapping[str, HandDataModule],
        *,
        weights: Mapping[str, float] | None = None,
        epoch_size: int | None = None,
        score_on: str | None = None,
        landmark_set: str | None = None,
        batch_size: int = 64,
        workers: int = 0,
        augmentation: Augmentation | None = None,
        seed: int = 0,
        keep: str = "disk",
    ) -> None:
        """Store the settings.

        Args:
            parts: Datasets by name, with crops of one size.
            weights: Share of each dataset in the hands of an epoch, in any unit; None weighs them by size.
            epoch_size: Hands in an epoch; None takes as many as there are.
            score_on: The part whose validation and test hands are used; None takes the first.
            landmark_set: Landmark set that is learnt; None takes that of the scored part.
            batch_size: Hands per batch and process.
            workers: Loading processes.
            augmentation: Applied to training batches of all parts.
            seed: Seed of the sample order and of the augmentation.
            keep: Place of the samples of training and validation: `disk`, `memory` or `device`.

        Raises:
            ValueError: Names do not match, crops differ in size, weights or the epoch are empty, or a part
                has an order of its own.
        """
        self.parts = dict(parts)
        self.score_on = score_on or next(iter(self.parts), "")
        self.weights = dict(weights) if weights is not None else None
        self.epoch_size = epoch_size
        self._check()
        scored = self.parts[self.score_on]
        self.landmark_set = landmark_set or scored.landmark_set
        self._refuse_own_orders()
        self._warn_about_landmark_sets()
        # Reported scores are those on this dataset.
        self.name = scored.name
        super().__init__(
            self._mixed,
            partial(scored.dataset, "val"),
            partial(scored.dataset, "test"),
            crop_size=scored.crop_size,
            batch_size=batch_size,
            workers=workers,
            augmentation=augmentation,
            seed=seed,
            keep=keep,
        )

    def train_dataloader(self) -> DataLoader[HandSample]:
        """Batches of equal size, mixed; fewer samples than one batch make a smaller batch."""
        counts = self.counts()
        for name, count in counts.items():
            logger.info("%s: %d of %d hands of an epoch.", name, count, sum(counts.values()))
        sizes = [len(part.dataset("train")) for part in self.parts.values()]
        sampler = WeightedShuffle(sizes, list(counts.values()), self.seed)
        return self._training_loader(sampler)

    def counts(self) -> dict[str, int]:
        """Hands of each part in an epoch."""
        sizes = {name: len(part.dataset("train")) for name, part in self.parts.items()}
        weights = self.weights or {name: float(size) for name, size in sizes.items()}
        total = self.epoch_size or sum(sizes.values())
        return dict(zip(sizes, shares([weights[name] for name in sizes], total), strict=True))

    def train_ground_truth(
        self, limit: int | None = None
    ) -> (
        tuple[Float[Tensor, "sample landmark=21 3"], Float[Tensor, "sample vertex 3"] | None] | None
    ):
        """3D ground truth of the scored part: a baseline belongs to one dataset."""
        return self.parts[self.score_on].train_ground_truth(limit)

    def ground_truth_dataset(self) -> HandDataset:
        """Training set of the scored part."""
        return self.parts[self.score_on].ground_truth_dataset()

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        """Pose and shape of the training hands of all parts that have them."""
        known = [part.train_parameters(limit) for part in self.parts.values()]
        found = [parameters for parameters in known if parameters is not None]
        if not found:
            return None
        joined = HandParameters.join(found)
        total = len(joined.shape)
        return joined.select(torch.tensor(evenly_spaced(total, limit or total)))

    def _mixed(self) -> MixedHands:
        return MixedHands({name: part.dataset("train") for name, part in self.parts.items()})

    def _check(self) -> None:
        if not self.parts:
            raise ValueError(
                "A mixture needs parts; conf/data/mixture.yaml shows how to name them."
            )
        if self.score_on not in self.parts:
            raise ValueError(
                f"score_on={self.score_on} is not one of the parts {sorted(self.parts)}."
            )
        weights = self.weights
        if weights is not None and weights.keys() != self.parts.keys():
            raise ValueError(
                f"There are weights for {sorted(weights)} and parts {sorted(self.parts)}; give each part one."
            )
        if weights is not None and (min(weights.values()) < 0 or not sum(weights.values()) > 0):
            raise ValueError(
                f"The weights {weights} must not be negative, and one must be positive."
            )
        if self.epoch_size is not None and self.epoch_size < 1:
            raise ValueError(f"epoch_size={self.epoch_size} must be at least 1, or null for all.")
        sizes = {name: part.crop_size for name, part in self.parts.items()}
        if len(set(sizes.values())) > 1:
            raise ValueError(
                f"The parts' crops differ in size, {sizes}; set one crop_size for all of them."
            )

    def _refuse_own_orders(self) -> None:
        for name, part in self.parts.items():
            if part.own_order is not None:
                raise ValueError(
                    f"The part {name} has {part.own_order}, and a mixture draws its hands in an order of its "
                    f"own, among all of them. Set data.parts.{name}.order=all, or train on {name} alone."
                )

    def _warn_about_landmark_sets(self) -> None:
        for name, part in self.parts.items():
            if part.landmark_set != self.landmark_set:
                logger.warning(
                    "The labels of %s follow the landmark set %s, and the model learns the set %s: on the "
                    "open hand they differ by up to 14 mm at the MCPs, so that it learns a compromise.",
                    name, part.landmark_set, self.landmark_set,
                )  # fmt: skip
