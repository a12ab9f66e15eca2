"""Fit of hands to 2D landmarks with all knowledge, and the packaged lifter (Sec. 3.4)."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import torch

from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.fitting.descent import Descent, fit
from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import observed
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.prior import Prior
from hand_recon.runs.lifters import load_named, starts_of
from hand_recon.schema import HandBatch
from hand_recon.speed.measurement import Settings, Work, interleaved, ratios, spread
from hand_recon.speed.rows import Row, hands
from hand_recon.uncertainty import NegativeLogLikelihood, SquaredError, Staged

BATCHES = (1, 64, 1024)
ADAM_HANDS = 1
"""Hands that Adam fits for the comparison: it takes seconds per hand."""
LEVEL = "medium"


def measure(settings: Settings) -> Iterator[Row]:
    """Time the fit as the command `fit` does it, and Adam's on one hand."""
    hand = open_hand()
    lifter = load_named("default", hand)
    objective = Objective(
        hand,
        Prior.default(hand),
        Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5),
    )
    batches = BATCHES[:2] if settings.quick else BATCHES
    views = landmarks(max(batches), settings.cache)
    for batch in batches:
        seen = observed(views.select(slice(0, batch)))
        works: dict[str, Work] = {
            "fit": partial(
                fit, seen, objective, descent=Descent(), further=starts_of(lifter, hand)
            ),
            "lifter": partial(_lifted, lifter, views.select(slice(0, batch))),
        }
        if batch == ADAM_HANDS:
            works["adam"] = partial(fit, seen, objective, descent=Descent(solver="adam"))
        times = interleaved(works, settings)
        yield Row(
            suite="fit",
            work="fit with all knowledge, started by the lifter",
            size=hands(batch),
            items=batch,
            seconds=spread(times["fit"]),
            reference="the same loss by Adam" if "adam" in times else None,
            reference_seconds=spread(times["adam"]) if "adam" in times else None,
            ratio=ratios(times["adam"], times["fit"]) if "adam" in times else None,
        )
        yield Row(
            suite="fit",
            work="lifter alone",
            size=hands(batch),
            items=batch,
            seconds=spread(times["lifter"]),
        )


def landmarks(count: int, cache: str) -> HandBatch:
    """Projected landmarks of synthetic hands, without images.

    Args:
        count: Number of hands.
        cache: Folder for what is precomputed.
    """
    views = SyntheticHands(
        "test", count, 224, LEVEL, cache_dir=Path(cache), pictures=False, with_vertices=False
    )
    return views.batch(list(range(count)))


@torch.no_grad()
def _lifted(lifter: torch.nn.Module, batch: HandBatch) -> object:
    return lifter(batch)
