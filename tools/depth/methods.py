"""Configurations of a fit by name, and their run on a set with times."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Float
from omegaconf import DictConfig
from torch import Tensor

from depth.sets import DepthSet
from hand_recon.command_line.composing import composed
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.fitting.in_parts import fit_in_parts, fit_part
from hand_recon.hand.model import HandModel
from hand_recon.runs.configuration import build_hand
from hand_recon.runs.fit_run import adapted_to_data
from hand_recon.runs.fitters import build_fitter, fitter_of

TABLE_1: Final = {
    name: (
        f"prior={prior}",
        f"data_term={term}",
        "descent.finger_table=false",
        "lifter=none",
        "landmark_set=knuckle",
    )
    for name, prior, term in (
        ("1 no knowledge", "none", "mse"),
        ("2 + ranges of motion", "biomechanics", "mse"),
        ("3 + functional anatomy", "functional_anatomy", "mse"),
        ("4 + non-penetration", "full", "mse"),
        ("5 + negative log-likelihood", "full", "mse_then_nll"),
    )
}
"""Rows of the paper's Table 1 as overrides of `conf/fit.yaml`, without what was learnt from landmarks
and without the table of finger poses, which is knowledge."""


@dataclass(frozen=True)
class Method:
    """A configuration of the fit."""

    name: str
    """Name for tables."""
    overrides: tuple[str, ...] = ()
    """Overrides of `conf/fit.yaml`, in Hydra's grammar."""

    @classmethod
    def parsed(cls, text: str) -> "Method":
        """Read `NAME=override,override`; commas inside brackets do not part overrides.

        Raises:
            ValueError: There is no name.
        """
        name, _, rest = text.partition("=")
        if not name:
            raise ValueError(
                f"Found the method {text!r} without a name; expected NAME=override,override."
            )
        return cls(name, tuple(_parted(rest)))

    def config(self, landmark_set: str | None = None) -> DictConfig:
        """The whole configuration.

        Args:
            landmark_set: Landmark set of the hands, unless the overrides have another one.
        """
        first = [] if landmark_set is None else [f"landmark_set={landmark_set}"]
        return adapted_to_data(composed("fit", [*first, *self.overrides]))


def _parted(text: str) -> list[str]:
    """Split at the commas outside of brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part for part in parts if part]


@dataclass(frozen=True)
class Run:
    """Hands of a set, fitted by a method."""

    method: Method
    parts: tuple[FittedHands, ...]
    """The hands, in the set's order."""
    batch_ms: float
    """Processor time of a hand among others, milliseconds on one thread."""
    alone_ms: float
    """Processor time of one hand alone, median of some, milliseconds on one thread."""

    @property
    def landmarks_3d(self) -> Float[Tensor, "hand landmark=21 3"]:
        """Fitted landmarks, camera frame, metres."""
        return torch.cat([part.prediction.landmarks_3d for part in self.parts]).double()


def run(method: Method, hands: DepthSet, alone: int = 20) -> Run:
    """Fit a set, and time it.

    Times are processor times, which other processes disturb less than the clock.

    Args:
        method: The configuration.
        hands: The set.
        alone: Number of hands that are also fitted one by one, spread over the set.

    Raises:
        ValueError: A hand was not fitted.
    """
    config = method.config(hands.landmark_set)
    hand: HandModel = build_hand(config)
    fitter = build_fitter(config, hand)
    landmarks = hands.landmarks
    # What is loaded or computed on first use is not the cost of a hand.
    fit_part(landmarks.select(slice(0, 2)), fitter)
    began = time.process_time()
    if config.same_person:
        fitter = fitter_of(config, hand, landmarks)
    parts = tuple(fit_in_parts(landmarks, fitter))
    batch_ms = 1000 * (time.process_time() - began) / len(hands)
    wrong = sum(int((~part.fitted).sum()) for part in parts)
    if wrong:
        raise ValueError(
            f"{method.name} left {wrong} of {len(hands)} hands of {hands.name} without a finite result; "
            "expected none, since leaving hands out would change the mean."
        )
    times = []
    for place in _spread(len(hands), alone):
        one = landmarks.select(slice(place, place + 1))
        began = time.process_time()
        fit_part(one, fitter)
        times.append(1000 * (time.process_time() - began))
    alone_ms = float(torch.tensor(times).median()) if times else float("nan")
    return Run(method, parts, batch_ms, alone_ms)


def _spread(count: int, some: int) -> Sequence[int]:
    """Positions of some hands, evenly spread over all."""
    return [place * count // some for place in range(some)] if some < count else range(count)
