"""Selection among several starts of each hand, which are behind each other (Sec. 3.4)."""

from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hand_recon.fitting.second_order.landmark_covariance import ALIKE, repeated
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.levenberg_marquardt import Reached

UNLIKE: Final = 0.015
"""Distance of a landmark from which on two starts differ, before they have ended, metres."""


def rows_of(hands: int, starts: int) -> Int[Tensor, " start"]:
    """Index of the hand of each start, where every hand has the same number of starts.

    Args:
        hands: Number of hands.
        starts: Number of all starts.
    """
    return torch.arange(hands).repeat_interleave(starts // max(hands, 1))


def is_repeated(
    problem: Problem, here: Reached, hands: int, near: float = ALIKE
) -> Bool[Tensor, "hand start"]:
    """Mask of the results that are as near an earlier one of their hand as if they were the same minimum.

    Args:
        problem: The loss of every start.
        here: The results, those of a hand behind each other, the best first.
        hands: Number of hands.
        near: Largest distance of a landmark within which two results are the same, metres.
    """
    at = problem.projection(here.unknowns, problem.observation.intrinsics, problem.inverse)
    points = at.points.permute(2, 1, 0).unflatten(0, (hands, -1))
    return repeated(points, here.model.value.view(hands, -1), near)


def unlike(problem: Problem, here: Reached, count: int) -> Int[Tensor, " kept"]:
    """Indices of the best starts of each hand that differ, filled up with the best of the others.

    Args:
        problem: The loss of every hand.
        here: The starts, those of a hand behind each other.
        count: Starts to keep per hand, if there are so many.
    """
    hands = len(problem.target)
    each = len(here.damping) // max(hands, 1)
    order = least(here.model.value, hands, each, in_order=False)
    again = is_repeated(problem[rows_of(hands, hands * each)], here[order], hands, UNLIKE)
    first = again.int().argsort(dim=1, stable=True)[:, :count]
    return order.view(hands, each).gather(1, first).sort(dim=1).values.flatten()


def all_but(some: Tensor, count: int) -> Int[Tensor, " other"]:
    """Indices that are not among some.

    Args:
        some: Indices.
        count: Number of all indices.
    """
    mask = torch.ones(count, dtype=torch.bool)
    mask[some] = False
    return mask.nonzero()[:, 0]


def least(
    value: Float[Tensor, " start"], hands: int, count: int, *, in_order: bool = True
) -> Int[Tensor, " kept"]:
    """Indices of the starts of least loss of each hand, in the order of the hands.

    Args:
        value: Loss of every start; those of a hand are behind each other.
        hands: Number of hands.
        count: Starts to keep per hand, if there are so many.
        in_order: Whether the starts of a hand keep their order; otherwise the least loss is first.
    """
    each = len(value) // max(hands, 1)
    by_hand = value.nan_to_num(torch.inf).view(hands, each)
    kept = by_hand.argsort(dim=1, stable=True)[:, :count]
    if in_order:
        kept = kept.sort(dim=1).values
    return (kept + each * torch.arange(hands)[:, None]).flatten()
