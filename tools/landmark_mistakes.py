"""Mistakes in landmarks and cameras, made on purpose; `tools/measure_verdicts.py` counts which are caught."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
import torch

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks, boxes
from hand_recon.hand.skeleton import landmark_permutation

Mistake = Callable[[ImageLandmarks, np.random.Generator], ImageLandmarks]
"""Function that makes one mistake in every hand."""

IMAGE_SIZE: Final = (640, 480)
"""Width and height of the images before a known camera, pixels."""


def _reordered(orders: Callable[[np.random.Generator], list[int]]) -> Mistake:
    """Take the landmarks of every hand in an order that is drawn for it."""

    def make(hands: ImageLandmarks, random: np.random.Generator) -> ImageLandmarks:
        order = torch.tensor([orders(random) for _ in range(len(hands))])
        row = torch.arange(len(hands))[:, None]
        return replace(
            hands,
            landmarks_2d=hands.landmarks_2d[row, order],
            labelled=hands.labelled[row, order],
            confidence=None if hands.confidence is None else hands.confidence[row, order],
        )

    return make


def _read_as_ours(name: str) -> Mistake:
    """Take landmarks in the order of a convention for landmarks in FreiHAND's."""
    order = list(landmark_permutation("freihand", name))
    return _reordered(lambda random: order)


def _with_fingers(fingers: list[int]) -> list[int]:
    """Order of the landmarks with the fingers in another order."""
    return [0] + [1 + 4 * finger + part for finger in fingers for part in range(4)]


def _two_exchanged(random: np.random.Generator) -> list[int]:
    fingers = list(range(5))
    first, second = random.choice(5, 2, replace=False)
    fingers[first], fingers[second] = fingers[second], fingers[first]
    return _with_fingers(fingers)


def _moved(share: float, count: int = 1) -> Mistake:
    """Move landmarks of every hand by a share of its extent, in random directions."""

    def make(hands: ImageLandmarks, random: np.random.Generator) -> ImageLandmarks:
        points = hands.landmarks_2d.clone()
        low, high = boxes(hands)
        reach = share * (high - low).amax(dim=-1)
        for hand in range(len(hands)):
            for landmark in random.choice(21, count, replace=False):
                angle = random.uniform(0, 2 * np.pi)
                points[hand, landmark] += reach[hand] * torch.tensor([np.cos(angle), np.sin(angle)])
        return replace(hands, landmarks_2d=points)

    return make


def _at_origin(hands: ImageLandmarks, random: np.random.Generator) -> ImageLandmarks:
    """Put four landmarks of every hand to (0, 0), as detectors write what they did not find."""
    points, labelled = hands.landmarks_2d.clone(), hands.labelled.clone()
    for hand in range(len(hands)):
        lost = random.choice(21, 4, replace=False)
        points[hand, lost], labelled[hand, lost] = 0.0, True
    return replace(hands, landmarks_2d=points, labelled=labelled)


def _linear(matrix: list[list[float]]) -> Mistake:
    """Move all points by a matrix, about the middle of the hand's box."""

    def make(hands: ImageLandmarks, random: np.random.Generator) -> ImageLandmarks:
        low, high = boxes(hands)
        middle = ((low + high) / 2)[:, None]
        moved = (hands.landmarks_2d - middle) @ torch.tensor(matrix, dtype=torch.float64).mT
        return replace(hands, landmarks_2d=moved + middle)

    return make


def _scattered(hands: ImageLandmarks, random: np.random.Generator) -> ImageLandmarks:
    """Draw all landmarks uniformly in the hand's box."""
    low, high = boxes(hands)
    share = torch.from_numpy(random.random((len(hands), 21, 2)))
    points = low[:, None] + share * (high - low)[:, None]
    return replace(hands, landmarks_2d=torch.where(hands.labelled[..., None], points, torch.nan))


def _other_side(hands: ImageLandmarks, random: np.random.Generator) -> ImageLandmarks:
    return replace(hands, left=~hands.left)


def _depth_as_sigma(hands: ImageLandmarks, random: np.random.Generator) -> ImageLandmarks:
    depth = torch.from_numpy(random.uniform(440, 510, (len(hands), 21)))
    return replace(hands, sigma=depth, confidence=None)


def _depth_as_confidence(hands: ImageLandmarks, random: np.random.Generator) -> ImageLandmarks:
    depth = torch.from_numpy(random.uniform(0.01, 0.2, (len(hands), 21)))
    return replace(hands, confidence=depth, sigma=None)


def _camera(
    u: float = 1.0, v: float = 1.0, focal: float = 1.0, centre: float = 1.0, aspect: float = 1.0
) -> Mistake:
    """Multiply the rows, the focal lengths or the principal points of camera matrices."""
    factors = torch.tensor(
        [[u * focal, u, u * centre], [v, v * focal * aspect, v * centre], [1, 1, 1]],
        dtype=torch.float64,
    )

    def make(hands: ImageLandmarks, random: np.random.Generator) -> ImageLandmarks:
        if hands.intrinsics is None:
            raise ValueError("Found hands without cameras; expected known cameras to change.")
        return replace(hands, intrinsics=hands.intrinsics * factors)

    return make


OF_LANDMARKS: Final[dict[str, Mistake]] = {
    "order interhand": _read_as_ours("interhand"),
    "order rhd": _read_as_ours("rhd"),
    "order ho3d": _read_as_ours("ho3d"),
    "order dart": _read_as_ours("dart"),
    "little finger first": _reordered(lambda random: _with_fingers([4, 3, 2, 1, 0])),
    "two fingers exchanged": _reordered(_two_exchanged),
    "one off by 30 %": _moved(0.3),
    "one off by 50 %": _moved(0.5),
    "one off by 100 %": _moved(1.0),
    "three off by 30 %": _moved(0.3, 3),
    "four at (0, 0)": _at_origin,
    "scattered": _scattered,
    "on a line": _linear([[1, 0], [0.5, 0]]),
    "u times 1.33": _linear([[1.33, 0], [0, 1]]),
    "u times 1.78": _linear([[1.78, 0], [0, 1]]),
    "u times 0.5": _linear([[0.5, 0], [0, 1]]),
    "depth as sigma": _depth_as_sigma,
    "depth as confidence": _depth_as_confidence,
    "other side": _other_side,
    "v upwards": _linear([[1, 0], [0, -1]]),
    "u and v exchanged": _linear([[0, 1], [1, 0]]),
}
"""Mistakes in the landmarks, by name."""

OF_CAMERAS: Final[dict[str, Mistake]] = {
    "K over image size": _camera(u=1 / IMAGE_SIZE[0], v=1 / IMAGE_SIZE[1]),
    "K of half the size": _camera(u=0.5, v=0.5),
    "K of twice the size": _camera(u=2.0, v=2.0),
    "focal length 4 (mm)": _camera(focal=4 / 600),
    "principal point 0": _camera(centre=0.0),
    "fy times 1.78": _camera(aspect=1.78),
}
"""Mistakes in the camera matrices, by name."""
