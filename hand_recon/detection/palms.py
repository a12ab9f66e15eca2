"""Palms in an image: MediaPipe's palm network, its anchors and the suppression of overlapping boxes.

Constants are those of MediaPipe 0.10.21: modules/palm_detection/palm_detection_cpu.pbtxt and
calculators/tflite/ssd_anchors_calculator.cc.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Final

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from hand_recon.detection.interpreter import Network
from hand_recon.detection.regions import Region, region_of_image, region_of_palm

GRIDS: Final = ((24, 2), (12, 6))
"""Cells along a side, and anchors in each cell: strides 8, then 16 three times, of a 192-pixel input."""

LARGEST_LOGIT: Final = 100.0
"""Logits are clipped to this size before the sigmoid."""

OVERLAP: Final = 0.3
"""Intersection over union beyond which two boxes are of one palm."""

DOUBTFUL: Final = 0.2
"""Least score of a palm that is worth a word when it is below the threshold (decision 54)."""

WRIST_POINT, MIDDLE_MCP_POINT = 0, 2


@dataclass(frozen=True)
class Palm:
    """One palm."""

    box: Float[np.ndarray, "4"]
    """Left, top, right and bottom, pixels of the image."""
    points: Float[np.ndarray, "point=7 2"]
    """Wrist; MCPs of index, middle, ring and little finger; CMC and MCP of the thumb; pixels."""
    score: float
    """Probability of a palm, 0 to 1."""

    @property
    def region(self) -> Region:
        """The square around the whole hand."""
        return region_of_palm(self.box, self.points[WRIST_POINT], self.points[MIDDLE_MCP_POINT])


@dataclass(frozen=True)
class PalmCandidates:
    """Everything that the palm network proposes, in shares of its square, before suppression."""

    boxes: Float[np.ndarray, "candidate 4"]
    """Left, top, right and bottom."""
    points: Float[np.ndarray, "candidate point=7 2"]
    """The seven points of `Palm.points`."""
    scores: Float[np.ndarray, " candidate"]
    """Probability of a palm, 0 to 1."""

    def select(self, which: Bool[np.ndarray, " candidate"]) -> "PalmCandidates":
        """The candidates of a mask."""
        return PalmCandidates(self.boxes[which], self.points[which], self.scores[which])

    def apart_from(self, others: "PalmCandidates") -> "PalmCandidates":
        """The candidates that overlap with none of the others by more than `OVERLAP`."""
        taken = [bool((overlaps(box, others.boxes) > OVERLAP).any()) for box in self.boxes]
        return self.select(~np.array(taken, dtype=bool))


class PalmNetwork:
    """MediaPipe's palm network: all palms of an image, the best first."""

    def __init__(self, model: Callable[[], bytes], threads: int = 1) -> None:
        """Store the network, which is loaded at the first image."""
        self.network = Network(model, threads)

    def __call__(
        self, image: UInt8[np.ndarray, "height width 3"], least: float, padding: float = 1.0
    ) -> list[Palm]:
        """Find palms.

        Args:
            image: RGB, bytes.
            least: Least score of a palm, 0 to 1.
            padding: Side of the square that the network sees, in longer sides of the image. The margin is
                black at 1, and the image's edge repeated beyond.

        Returns:
            Palms of at least that score, the best first, then the doubtful ones below it.
        """
        region = region_of_image(image.shape[0], image.shape[1], padding)
        border = cv2.BORDER_CONSTANT if padding == 1.0 else cv2.BORDER_REPLICATE
        raw, logits = self.network(region.crop(image, self.network.input_size, border))
        candidates = decode(raw, logits[:, 0], self.network.input_size)
        found = suppress(candidates.select(candidates.scores >= least))
        doubtful = suppress(
            candidates.select((candidates.scores < least) & (candidates.scores >= DOUBTFUL))
        )
        corner = np.array([region.x, region.y]) - region.side / 2
        return [
            Palm(
                np.tile(corner, 2) + box * region.side,
                corner + points * region.side,
                float(score),
            )
            for one in (found, doubtful.apart_from(found))
            for box, points, score in zip(one.boxes, one.points, one.scores, strict=True)
        ]


@cache
def anchors() -> Float[np.ndarray, "anchor=2016 2"]:
    """Centres of the anchors, shares of the square: row by row, the repeats of a cell together."""
    centres = []
    for cells, repeats in GRIDS:
        middle = (np.arange(cells) + 0.5) / cells
        y, x = np.meshgrid(middle, middle, indexing="ij")
        centres.append(np.stack([x, y], axis=-1).reshape(-1, 2).repeat(repeats, axis=0))
    return np.concatenate(centres)


def decode(
    raw: Float[np.ndarray, "anchor=2016 18"], logits: Float[np.ndarray, " anchor=2016"], size: int
) -> PalmCandidates:
    """Boxes, points and scores from the network's outputs; boxes of negative size are left out.

    Args:
        raw: Centre, width and height of the box, then seven points, pixels from the anchor.
        logits: Logits of the scores.
        size: Side of the network's input, pixels.
    """
    values = raw.astype(np.float64).reshape(-1, 9, 2) / size
    centre, extent = values[:, 0] + anchors(), values[:, 1]
    scores = 1 / (1 + np.exp(-np.clip(logits.astype(np.float64), -LARGEST_LOGIT, LARGEST_LOGIT)))
    decoded = PalmCandidates(
        np.concatenate([centre - extent / 2, centre + extent / 2], axis=1),
        values[:, 2:] + anchors()[:, None],
        scores,
    )
    return decoded.select(np.asarray((extent >= 0).all(axis=1)))


def suppress(candidates: PalmCandidates) -> PalmCandidates:
    """One palm for each group of overlapping candidates: their mean, weighted by score; the best first.

    The best of those that are left is joined with all that overlap with it by more than `OVERLAP`; the result
    has its score.
    """
    left = candidates.select(np.ones(len(candidates.scores), dtype=bool))
    boxes, points, scores = [], [], []
    while len(left.scores):
        best = int(left.scores.argmax())
        group = overlaps(left.boxes[best], left.boxes) > OVERLAP
        # A box without area overlaps with nothing, itself included.
        group[best] = True
        weights = left.scores[group]
        boxes.append(np.average(left.boxes[group], axis=0, weights=weights))
        points.append(np.average(left.points[group], axis=0, weights=weights))
        scores.append(left.scores[best])
        left = left.select(~group)
    return PalmCandidates(
        np.array(boxes).reshape(-1, 4),
        np.array(points).reshape(-1, 7, 2),
        np.array(scores, dtype=float),
    )


def best_of_overlapping(palms: Iterable[Palm]) -> list[Palm]:
    """Palms of several looks at one image without repetitions, the best first.

    Of palms that overlap by more than `OVERLAP`, the best is kept as it is.
    """
    kept: list[Palm] = []
    for palm in sorted(palms, key=lambda palm: -palm.score):
        if (
            not kept
            or not (overlaps(palm.box, np.stack([one.box for one in kept])) > OVERLAP).any()
        ):
            kept.append(palm)
    return kept


def overlaps(
    box: Float[np.ndarray, "4"], others: Float[np.ndarray, "box 4"]
) -> Float[np.ndarray, " box"]:
    """Intersection over union of one box with others; zero where both have no area.

    Args:
        box: Left, top, right and bottom.
        others: The same, one row for each.
    """
    sides = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    shared = np.clip(sides, 0, None).prod(axis=1)
    joint = (box[2:] - box[:2]).prod() + (others[:, 2:] - others[:, :2]).prod(axis=1) - shared
    return np.divide(shared, joint, out=np.zeros_like(shared), where=joint > 0)
