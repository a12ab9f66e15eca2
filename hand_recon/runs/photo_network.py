"""A trained network that looks at photographs: `hand-recon predict … ckpt=<run>` (decision 71)."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from hand_recon.data.augment import to_float
from hand_recon.data.crop import CropPolicy, crop_points
from hand_recon.data.landmarks.image_landmarks import FEWEST
from hand_recon.detection.detector import DetectedHand
from hand_recon.fitting.seen_pose import believed
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.runs.photo_crops import frame_of, sample_of
from hand_recon.schema import REFERENCE_SIZE, HandEstimate, HandParameters, HandPrediction, collate

SMALLEST_SHARE: Final = 0.25
"""Least extent of landmarks, in sides of the box that they were found in, about which the second crop is
cut; smaller ones are no hand's."""

Pixels = UInt8[np.ndarray, "height width 3"]
Places = Float[np.ndarray, "hand landmark=21 2"]


@dataclass(frozen=True)
class PhotoNetwork:
    """A trained network and the crops that it looks at."""

    regressor: Regressor
    """Network in evaluation mode; it takes the camera of each crop."""
    crop: CropPolicy
    """Size of its crops, and what they are cut around."""
    name: str
    """Name of its checkpoint in the origin of hands."""
    sees_landmarks: bool
    """True if it takes the detector's landmarks, too."""
    finds_landmarks: bool
    """True if its landmarks can be fitted, since they are of the landmark set of the fit."""
    sees_pose: bool = True
    """True if the fit wants the pose that it sees in pixels alone, also of hands with landmarks."""
    sigma_factor: float = 1.0
    """Factor of its σ, fitted on the validation hands of its training."""

    def find(
        self, pixels: Pixels, hands: Sequence[DetectedHand]
    ) -> tuple[tuple[DetectedHand, ...], frozenset[int]]:
        """Find landmarks of the hands that have a box and no landmarks, by a first look at the box.

        Args:
            pixels: The photograph, RGB.
            hands: Hands of a detector.

        Returns:
            The hands with landmarks, and the positions of those that the network found. Their box is the one
            that the second crop is cut around: that of the landmarks, if the training cut there.

        Raises:
            ValueError: The network gives numbers that are not finite.
        """
        found = list(hands)
        which = [
            place
            for place, hand in enumerate(hands)
            if self.finds_landmarks and hand.box is not None and not has_landmarks(hand)
        ]
        if which:
            seen = self._look(pixels, [(hands[place], _box(hands[place])) for place in which])
            for place, hand in zip(which, seen.hands(hands[place] for place in which), strict=True):
                found[place] = replace(hand, box=self._second_frame(hand, _box(hands[place])))
        return tuple(found), frozenset(which)

    def place(
        self,
        pixels: Pixels,
        hands: Sequence[DetectedHand],
        found: frozenset[int],
        camera: Float[np.ndarray, "3 3"],
    ) -> tuple[tuple[DetectedHand, ...], HandEstimate]:
        """Estimate the hands of a photograph, and find their landmarks where the detector has none.

        Args:
            pixels: The photograph, RGB.
            hands: The hands, of `find`.
            found: Positions of those whose landmarks the network found: it sees the crop alone, and their
                landmarks are found again.
            camera: Camera matrix, pixels of the photograph.

        Returns:
            The hands, and an estimate of each, with σ in pixels of the photograph and, if `sees_pose`, the
            pose that the network sees in pixels alone, unless it finds the hand elsewhere than its landmarks.
            All is NaN for a hand with neither landmarks nor a box.

        Raises:
            ValueError: The network gives numbers that are not finite.
        """
        placed = list(hands)
        which = [place for place, hand in enumerate(hands) if place in found or has_landmarks(hand)]
        estimate = _unknown(len(hands))
        if which:
            crops = [self._crop_of(hands[place], found=place in found) for place in which]
            seen = self._look(pixels, crops, camera)
            pose = seen.prediction.parameters.joint_angles
            told = [row for row, (hand, _) in enumerate(crops) if has_landmarks(hand)]
            if told and self.sees_pose:
                blind = [(_without_landmarks(crops[row][0]), crops[row][1]) for row in told]
                in_pixels = self._look(pixels, blind, camera)
                given = [crops[row][0].landmarks_2d for row in told]
                pose = pose.index_put((torch.tensor(told),), in_pixels.believed_poses(given))
            estimate = _filled(
                estimate, torch.tensor(which), replace(seen.estimate(), seen_pose=pose)
            )
            again = seen.hands(hands[place] for place in which)
            for place, hand in zip(which, again, strict=True):
                placed[place] = hand if place in found else hands[place]
        return tuple(placed), estimate

    def _crop_of(
        self, hand: DetectedHand, *, found: bool
    ) -> tuple[DetectedHand, Float[np.ndarray, "4"]]:
        """A hand as the network sees it, and the box that its crop is cut around."""
        frame = _box(hand) if found else frame_of(hand, self.crop.around)
        return (hand if self.sees_landmarks and not found else _without_landmarks(hand)), frame

    @torch.no_grad()
    def _look(
        self,
        pixels: Pixels,
        crops: Sequence[tuple[DetectedHand, Float[np.ndarray, "4"]]],
        camera: Float[np.ndarray, "3 3"] | None = None,
    ) -> "_Seen":
        """Cut crops about boxes and look at them."""
        cut = [sample_of(pixels, hand, frame, self.crop, camera) for hand, frame in crops]
        prediction: HandPrediction = self.regressor(to_float(collate([one for one, _ in cut])))
        numbers = torch.cat([prediction.landmarks_3d, prediction.log_sigma], dim=-1)
        if not bool(numbers.isfinite().all()):
            raise ValueError(
                f"The network of {self.name} gives numbers that are not finite: its training diverged. Use "
                "another checkpoint."
            )
        calibrated = replace(
            prediction, log_sigma=prediction.log_sigma + math.log(self.sigma_factor)
        )
        return _Seen(calibrated, np.stack([matrix for _, matrix in cut]), self.crop.size)

    def _second_frame(
        self, hand: DetectedHand, box: Float[np.ndarray, "4"]
    ) -> Float[np.ndarray, "4"]:
        """Box of the second crop: that of the found landmarks, unless they are too close together."""
        if self.crop.around == "box":
            return box
        frame = frame_of(replace(hand, box=None), "joints")
        large_enough = _extent(frame) >= SMALLEST_SHARE * _extent(box)
        return frame if large_enough else box


@dataclass(frozen=True)
class _Seen:
    """Predictions of a network in crops of a photograph."""

    prediction: HandPrediction
    """Hands in their crops."""
    matrices: Float[np.ndarray, "hand 3 3"]
    """Matrices from pixels of the photograph to pixels of each crop."""
    size: int
    """Side of the crops, pixels."""

    @property
    def log_sigma(self) -> Float[Tensor, "hand landmark=21 2"]:
        """Logarithm of σ, which is in pixels of the photograph."""
        scale = np.sqrt(np.abs(np.linalg.det(self.matrices[:, :2, :2])))
        factor = torch.from_numpy(np.log(self.size / REFERENCE_SIZE / scale))
        return self.prediction.log_sigma.double() + factor[:, None, None]

    def estimate(self) -> HandEstimate:
        """The hands in the camera of the photograph."""
        return HandEstimate(self.prediction.parameters, self.log_sigma)

    def believed_poses(self, given: Sequence[Float[np.ndarray, "landmark=21 2"]]) -> Tensor:
        """Joint angles of each hand, radians; NaN where the network found it elsewhere than its landmarks.

        Args:
            given: Landmarks of each hand, pixels of the photograph.
        """
        in_crops = [crop_points(*pair) for pair in zip(given, self.matrices, strict=True)]
        found = self.prediction.found_2d
        points = torch.from_numpy(np.stack(in_crops)).to(found)
        return believed(self.prediction.parameters.joint_angles, found, points, self.size)

    def hands(self, seen: Iterator[DetectedHand]) -> Iterator[DetectedHand]:
        """The same hands with the landmarks that the network found in the crop, and their σ."""
        points = self.prediction.found_2d.double().numpy()
        # One σ per landmark: the mean square of both coordinates.
        sigma = torch.exp(2 * self.log_sigma).mean(dim=-1).sqrt().numpy()
        for place, hand in enumerate(seen):
            back = np.linalg.inv(self.matrices[place])
            yield replace(hand, landmarks_2d=crop_points(points[place], back), sigma=sigma[place])


def has_landmarks(hand: DetectedHand) -> bool:
    """True if a hand has enough landmarks for a fit, as `ImageLandmarks.usable`."""
    known = hand.landmarks_2d[np.isfinite(hand.landmarks_2d).all(axis=-1)]
    return len(known) >= FEWEST and bool(np.ptp(known, axis=0).max() > 0)


def _without_landmarks(hand: DetectedHand) -> DetectedHand:
    return replace(hand, landmarks_2d=np.full((21, 2), np.nan), confidence=None)


def _box(hand: DetectedHand) -> Float[np.ndarray, "4"]:
    if hand.box is None:
        raise AssertionError
    return np.asarray(hand.box, dtype=np.float64)


def _extent(box: Float[np.ndarray, "4"]) -> float:
    return float((box[2:] - box[:2]).max())


def _unknown(hands: int) -> HandEstimate:
    def numbers(*shape: int, kind: torch.dtype = torch.float32) -> Tensor:
        return torch.full((hands, *shape), math.nan, dtype=kind)

    parameters = HandParameters(numbers(15, 3), numbers(10), numbers(3, 3), numbers(3))
    return HandEstimate(parameters, numbers(21, 2, kind=torch.float64), seen_pose=numbers(15, 3))


def _filled(estimate: HandEstimate, rows: Tensor, some: HandEstimate) -> HandEstimate:
    """An estimate with some rows replaced."""
    order = torch.arange(len(estimate.log_sigma))
    order[rows] = len(order) + torch.arange(len(rows))
    return HandEstimate.join([estimate, some]).select(order)
