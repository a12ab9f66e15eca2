"""F-scores of two surfaces without correspondence, F@5 and F@15 (Knapitsch et al., TOG 2017).

The nearest neighbour only matters where it is nearer than the threshold. So the points of a hand are sorted
along its longest direction, and a block of them is compared with those points of the other hand that lie
within the threshold along it, by a matrix product in single precision that stays in the cache. Distances
too near to a threshold for single precision are measured again in double precision, so that the counts are
exact. In NumPy: at this size a call costs as much as its arithmetic, and one of PyTorch three times as much.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

F_THRESHOLDS: Final = (0.005, 0.015)
"""The benchmarks' thresholds, metres: 5 and 15 mm."""

BLOCK: Final = 195
"""Rows of one matrix product: 778 vertices in four blocks, the fastest on a core with 1 MiB of L2."""

ROUND_OFF: Final = 13 * 2.0**-24
"""Relative error of a squared distance in single precision, over the squared sum of both norms.

Five products and their sum, each term already rounded: at most twelve units of round-off, and one of the
threshold that it is compared with.
"""

HANDS: Final = 32
"""Hands prepared together, few enough for the cache."""


def f_score(
    ground_truth: Float[Tensor, "hand point 3"],
    prediction: Float[Tensor, "hand other_point 3"],
    thresholds: tuple[float, ...] = F_THRESHOLDS,
) -> Float[Tensor, "hand threshold"]:
    """F-score: harmonic mean of the shares of each surface's points that are near the other surface.

    Args:
        ground_truth: Ground-truth vertices, metres.
        prediction: Predicted vertices, metres; their number may differ.
        thresholds: Distances to the nearest point below which a point is near, metres.

    Returns:
        One value per hand and threshold, 0 to 1; zero if no point is near the other surface.
    """
    scores = [
        _f_score(some_ground_truth.double().numpy(), some_prediction.double().numpy(), thresholds)
        for some_ground_truth, some_prediction in zip(
            ground_truth.split(HANDS), prediction.split(HANDS), strict=True
        )
    ]
    return torch.from_numpy(np.concatenate(scores))


@dataclass(frozen=True)
class _Sorted:
    """Points of some hands, sorted along one direction of each hand."""

    order: NDArray[np.int64]
    """Hands × points: the number of each point before it was sorted."""
    along: NDArray[np.float32]
    """Hands × points: position along the direction, metres."""
    coordinates: NDArray[np.float32]
    """Hands × 3 × points, from the centre, metres."""
    squared: NDArray[np.float32]
    """Hands × points: squared distance to the centre."""


def _f_score(
    ground_truth: NDArray[np.float64],
    prediction: NDArray[np.float64],
    thresholds: tuple[float, ...],
) -> NDArray[np.float64]:
    if not len(ground_truth):
        return np.empty((0, len(thresholds)))
    # A matrix product: the mean along the middle axis takes eight times as long.
    centre = np.full((1, ground_truth.shape[1]), 1 / ground_truth.shape[1]) @ ground_truth
    centred = _centred(ground_truth, centre)
    axis = np.linalg.eigh(centred @ centred.swapaxes(1, 2)).eigenvectors[..., -1:].swapaxes(1, 2)
    clouds = _sorted(centred, axis), _sorted(_centred(prediction, centre), axis)
    # A hundredth more than the largest threshold: beyond it, distances need not be exact.
    nearest = _nearest_squared(*clouds, 1.01 * max(thresholds))
    scores = []
    for threshold in thresholds:
        # Not the centred points: their rounding would decide where a distance equals a threshold.
        points = ground_truth, prediction
        recall = _share_nearer(nearest[0], clouds[0], points, threshold)
        precision = _share_nearer(nearest[1], clouds[1], points[::-1], threshold)
        total = recall + precision
        scores.append(2 * recall * precision / np.where(total > 0, total, 1.0))
    return np.stack(scores, axis=-1)


def _centred(points: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float32]:
    """Coordinates in long rows, hands × 3 × points, from a centre."""
    centred = np.empty((len(points), 3, points.shape[1]), dtype=np.float32)
    # Rounded after the subtraction.
    np.subtract(points.swapaxes(1, 2), centre.swapaxes(1, 2), out=centred, casting="same_kind")
    return centred


def _sorted(centred: NDArray[np.float32], axis: NDArray[np.float32]) -> _Sorted:
    count = centred.shape[2]
    along = (axis @ centred)[:, 0]
    # NumPy sorts whole numbers ten times as fast as it finds an order: the point's number is the lower half.
    steps = along * (2.0**30 / max(float(np.abs(along).max()), 2.0**-60))
    keys = (steps.astype(np.int64) << 32) | np.arange(count)
    keys.sort(axis=1)
    order = keys & 0xFFFFFFFF
    # Flat indices: of each hand's rows x, y and z, one after the other.
    rows = (np.arange(centred.shape[0] * 3) * count).reshape(-1, 3, 1)
    coordinates = centred.ravel().take(order[:, None] + rows)
    squared = np.einsum("hcp,hcp->hp", coordinates, coordinates)
    return _Sorted(order, (axis @ coordinates)[:, 0], coordinates, squared)


def _nearest_squared(
    ground_truth: _Sorted, prediction: _Sorted, reach: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Squared distances to the nearest point of the other cloud where it is within reach.

    Elsewhere the value is infinite or the squared distance to another point out of reach.
    """
    count = ground_truth.along.shape[1]
    first = ground_truth.along[:, ::BLOCK]
    last = ground_truth.along[:, np.minimum(np.arange(BLOCK, count + BLOCK, BLOCK), count) - 1]
    along = torch.from_numpy(prediction.along)
    starts = torch.searchsorted(along, torch.from_numpy(np.ascontiguousarray(first - reach)))
    stops = torch.searchsorted(
        along, torch.from_numpy(np.ascontiguousarray(last + reach)), right=True
    )
    # Factors whose product is |x|² + |y|² − 2 x·y: five columns and five rows.
    rows = _with_two_rows(ground_truth.coordinates, ground_truth.squared, 1.0)
    columns = _with_two_rows(-2 * prediction.coordinates, 1.0, prediction.squared)
    windows = torch.stack([starts, stops], dim=-1).tolist()
    return _search(rows.swapaxes(1, 2), columns, windows)


def _with_two_rows(
    coordinates: NDArray[np.float32],
    fourth: NDArray[np.float32] | float,
    fifth: NDArray[np.float32] | float,
) -> NDArray[np.float32]:
    factor = np.empty((len(coordinates), 5, coordinates.shape[2]), dtype=np.float32)
    factor[:, :3], factor[:, 3], factor[:, 4] = coordinates, fourth, fifth
    return factor


def _search(
    rows: NDArray[np.float32], columns: NDArray[np.float32], windows: list[list[list[int]]]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Nearest squared distances along the rows and along the columns, block by block."""
    count, other_count = rows.shape[1], columns.shape[2]
    of_ground_truth = np.full((len(rows), count), np.inf, dtype=np.float32)
    of_prediction = np.full((len(rows), other_count), np.inf, dtype=np.float32)
    # As whole numbers, floats that are not negative have the same order, and NumPy finds the least in two
    # thirds of the time. Negative ones are zero but for the rounding, in any order.
    along_rows, along_columns = of_ground_truth.view(np.int32), of_prediction.view(np.int32)
    # One buffer for every product: fresh memory costs more than the arithmetic.
    buffer = np.empty(BLOCK * other_count, dtype=np.float32)
    for hand, blocks in enumerate(windows):
        for block, (start, stop) in enumerate(blocks):
            if start >= stop:
                continue
            first, last = block * BLOCK, min((block + 1) * BLOCK, count)
            squared = buffer[: (last - first) * (stop - start)].reshape(last - first, stop - start)
            np.matmul(rows[hand, first:last], columns[hand, :, start:stop], out=squared)
            whole = squared.view(np.int32)
            np.minimum.reduce(whole, axis=1, out=along_rows[hand, first:last])
            window = along_columns[hand, start:stop]
            np.minimum(window, np.minimum.reduce(whole, axis=0), out=window)
    return of_ground_truth, of_prediction


def _share_nearer(
    squared: NDArray[np.float32],
    cloud: _Sorted,
    clouds: tuple[NDArray[np.float64], NDArray[np.float64]],
    threshold: float,
) -> NDArray[np.float64]:
    """Share of the first cloud's points that are nearer than the threshold to the second."""
    points, others = clouds
    norm = np.sqrt(cloud.squared)
    tolerance = ROUND_OFF * np.square(2 * norm + threshold)
    nearer = squared < threshold**2 - tolerance
    doubtful = (squared <= threshold**2 + tolerance) & ~nearer
    counts = np.count_nonzero(nearer, axis=1)
    hands, places = doubtful.nonzero()
    for hand, point in zip(hands, cloud.order[hands, places], strict=True):
        difference = others[hand] - points[hand, point]
        nearest = math.sqrt(np.einsum("pc,pc->p", difference, difference).min())
        counts[hand] += nearest < threshold
    return counts / squared.shape[1]
