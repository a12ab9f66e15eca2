"""Lint check of sequences in another order, as of a folder's order in place of the benchmark's list."""

from typing import Final

import torch
from jaxtyping import Float, Int
from torch import Tensor

WINDOW: Final = 16
"""Number of consecutive inspected frames that are compared with the ground truth together."""

FEWEST_WINDOWS: Final = 4
"""Least number of windows; with fewer, a common displacement may be chance."""

SHARE: Final = 0.1
"""Least share of displaced windows that agree with a neighbour."""


def block_displacements(
    distance: Float[Tensor, "hand frame"], frames: Int[Tensor, " hand"]
) -> Int[Tensor, " hand"] | None:
    """Displacement of each inspected frame, where whole blocks of frames are displaced alike.

    Every window of consecutive predictions is compared with every run of the ground truth. Two neighbouring
    windows that fit best at the same displacement do not do so by chance, as there are as many displacements
    as frames.

    Args:
        distance: Distance of each inspected prediction from the ground truth of every frame.
        frames: Number of each inspected frame, increasing.

    Returns:
        Number of the fitting ground truth minus the frame's own number; None if no blocks are displaced.
    """
    windows = [part for part in torch.arange(len(frames)).split(WINDOW) if len(part) == WINDOW]
    if len(windows) < FEWEST_WINDOWS:
        return None
    best = torch.tensor([_best_displacement(distance, frames, window) for window in windows])
    agrees = torch.zeros(len(best), dtype=torch.bool)
    same = best[1:] == best[:-1]
    agrees[1:] |= same
    agrees[:-1] |= same
    if int((agrees & (best != 0)).sum()) < max(2, SHARE * len(best)):
        return None
    candidates = best[agrees].unique()
    return _assigned(distance, frames, candidates)


def _best_displacement(
    distance: Float[Tensor, "hand frame"], frames: Tensor, window: Tensor
) -> int:
    """Displacement at which a window's predictions are nearest to the ground truth."""
    count = distance.shape[1]
    own = frames[window]
    shifts = torch.arange(-int(own[0]), count - int(own[-1]))
    costs = distance[window[:, None], own[:, None] + shifts[None]].mean(dim=0)
    return int(shifts[costs.argmin()])


def _assigned(
    distance: Float[Tensor, "hand frame"], frames: Tensor, candidates: Tensor
) -> Int[Tensor, " hand"]:
    """Displacement of each frame among a few, with as few changes as the distances justify.

    The least sum of distances and of a cost for each change is found by dynamic programming (Viterbi).
    """
    wanted = frames[:, None] + candidates[None]
    inside = (wanted >= 0) & (wanted < distance.shape[1])
    rows = torch.arange(len(frames))[:, None]
    costs = distance[rows, wanted.clamp(0, distance.shape[1] - 1)]
    costs = torch.where(inside, costs, 10 * distance.max())
    change = 2 * float(distance.median())
    total, before = costs[0], []
    for row in costs[1:]:
        least = total.min() + change
        changed = total > least
        before.append(torch.where(changed, total.argmin(), torch.arange(len(candidates))))
        total = torch.minimum(total, least) + row
    place = int(total.argmin())
    places = [place]
    for step in reversed(before):
        place = int(step[place])
        places.append(place)
    chosen = candidates[torch.tensor(places[::-1])]
    # Frames at an end, whose ground truth is not in the file.
    there = (frames + chosen >= 0) & (frames + chosen < distance.shape[1])
    return torch.where(there, chosen, 0)
