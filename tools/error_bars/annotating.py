"""Simulated annotation: a small model learns from the images that a ranking lists first, or from random ones.

The model is a Gaussian process from 21 landmarks in the image to the 21 in space, which gives its own error
bars. The images are views of synthetic hands, single ones or in clips whose frames are almost alike.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

import numpy as np
from jaxtyping import Float, Int

from error_bars.records import uncertain_hands
from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.hand.skeleton import ROOT_LANDMARK
from hand_recon.runs.ranking import ranked_images

LENGTH: Final = 4.0
"""Distance of two inputs at which the process correlates by 0.61, in units of 60 pixels; of 2, 4 and 8 the
one of the least error with all labels."""

NOISE: Final = 0.05
"""Variance of a label, as a share of that of the landmarks."""

FRAME_NOISE: Final = 1.0
"""Standard deviation of a landmark between frames of a clip, pixels."""


@dataclass(frozen=True)
class Views:
    """Hands in images, with their ground truth."""

    seen: Float[np.ndarray, "hand 42"]
    """Landmarks in the image about their mean, units of 60 pixels; zero where one is missing."""
    truth: Float[np.ndarray, "hand 63"]
    """Landmarks from the root, camera's axes, metres."""

    @classmethod
    def of(cls, split: str, count: int, cache: Path) -> Self:
        """Views of synthetic hands.

        Args:
            split: `train` or `val`.
            count: Number of hands.
            cache: Folder for the views.
        """
        hands = SyntheticHands(
            split, count, 224, "hard", cache_dir=cache, pictures=False, with_vertices=False
        )
        batch = hands.batch(list(range(count)))
        seen = batch.landmarks_2d.double().masked_fill(~batch.labelled[..., None], float("nan"))
        seen = (seen - seen.nanmean(dim=1, keepdim=True)).nan_to_num(0.0) / 60
        truth = hands.landmarks_3d.double()
        truth = truth - truth[:, ROOT_LANDMARK, None]
        return cls(seen.flatten(1).numpy(), truth.flatten(1).numpy())

    def __len__(self) -> int:
        return len(self.seen)

    def rows(self, which: Int[np.ndarray, " row"]) -> "Views":
        """Some of the hands."""
        return Views(self.seen[which], self.truth[which])

    def as_clips(self, clips: int, frames: int, seed: int) -> "Views":
        """Frames of clips, each about one of these hands; a few clips are much longer than most.

        Args:
            clips: Number of clips.
            frames: Number of frames of all clips together, nearly.
            seed: Seed of the choice, the lengths and the frames.
        """
        random = np.random.default_rng(seed)
        chosen = random.permutation(len(self))[:clips]
        shares = random.pareto(1.0, clips) + 1
        lengths = np.maximum(1, np.round(shares / shares.sum() * frames)).astype(int)
        which = self.rows(np.repeat(chosen, lengths))
        noise = FRAME_NOISE / 60 * random.normal(size=which.seen.shape)
        return Views(which.seen + noise, which.truth)


@dataclass(frozen=True)
class Learner:
    """Gaussian process that was given some labels."""

    labelled: Views
    """Hands with labels."""

    def __call__(
        self, seen: Float[np.ndarray, "hand 42"]
    ) -> tuple[Float[np.ndarray, "hand 63"], Float[np.ndarray, "hand 21"]]:
        """Predict landmarks, metres, and the variance of each along an axis, square metres."""
        truth = self.labelled.truth
        mean, inputs = truth.mean(axis=0), self.labelled.seen
        gram = _kernel(inputs, inputs) + NOISE * np.eye(len(inputs))
        across = _kernel(seen, inputs)
        solved = np.linalg.solve(gram, np.concatenate([truth - mean, across.T], axis=1))
        found = mean + across @ solved[:, :63]
        left = 1 + NOISE - (across * solved[:, 63:].T).sum(axis=1)
        spread = np.square(truth - mean).mean(axis=0).reshape(21, 3).mean(axis=1)
        return found, left[:, None] * spread

    def error(self, held_out: Views) -> float:
        """Mean distance of the landmarks of other hands, millimetres."""
        off = (self(held_out.seen)[0] - held_out.truth).reshape(-1, 21, 3)
        return 1000 * float(np.linalg.norm(off, axis=-1).mean())


def _kernel(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    squared = np.square(one[:, None] - other[None]).sum(axis=-1)
    return np.exp(-squared / (2 * LENGTH**2))


Chooser = Callable[[Learner, Views, int], Int[np.ndarray, " row"]]
"""From a model, images without labels and a number to the rows of those that are labelled next."""


def by_ranking(learner: Learner, unlabelled: Views, count: int) -> Int[np.ndarray, " row"]:
    """The images that `rank=uncertainty` lists first."""
    found, variance = learner(unlabelled.seen)
    names = [str(row) for row in range(len(unlabelled))]
    covariance = variance[:, :, None, None] * np.eye(3)
    hands = uncertain_hands(names, found.reshape(-1, 21, 3), covariance)
    return np.array([int(one.image) for one in ranked_images(hands, names)[:count]])


def at_random(seed: int) -> Chooser:
    """Function that chooses any images."""
    random = np.random.default_rng(seed)
    return lambda _, unlabelled, count: random.permutation(len(unlabelled))[:count]


def learning_curve(
    pool: Views, held_out: Views, choose: Chooser, *, seed: int, step: int, rounds: int
) -> Float[np.ndarray, " round"]:
    """Errors on other hands as labels are added, millimetres; the first of them after a random choice.

    Args:
        pool: Images to label.
        held_out: Hands of the error.
        choose: Chooses the images that are labelled next.
        seed: Seed of the first choice, which is the same for all choosers.
        step: Labels that the first choice and each round give.
        rounds: Rounds after the first choice.
    """
    order = np.random.default_rng(seed).permutation(len(pool))
    labelled, rest = order[:step], order[step:]
    errors = [Learner(pool.rows(labelled)).error(held_out)]
    for _ in range(rounds):
        chosen = choose(Learner(pool.rows(labelled)), pool.rows(rest), step)
        labelled, rest = np.concatenate([labelled, rest[chosen]]), np.delete(rest, chosen)
        errors.append(Learner(pool.rows(labelled)).error(held_out))
    return np.array(errors)
