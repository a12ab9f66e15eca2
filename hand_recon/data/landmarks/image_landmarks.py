"""2D landmarks of hands in pixels of whole images: the input of a fit (Sec. 3.3)."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.camera import move_points
from hand_recon.schema import HandEstimate

FEWEST: Final = 4
"""Smallest number of labelled landmarks that determine a hand's position and size."""


@dataclass(frozen=True)
class ImageLandmarks:
    """Landmarks of N hands, in double precision, one camera per hand where cameras are known.

    Pixel i covers [i, i + 1), as everywhere in the project.
    """

    landmarks_2d: Float[Tensor, "hand landmark=21 2"]
    """Pixels of the image; NaN where there is no label."""
    labelled: Bool[Tensor, "hand landmark=21"]
    """True for landmarks with a label."""
    left: Bool[Tensor, " hand"]
    """True for left hands."""
    names: tuple[str, ...]
    """Name of each hand: its image's file name, or its position in the file."""
    sigma: Float[Tensor, "hand landmark=21"] | None = None
    """Standard deviation of each label, pixels of the image; NaN where unknown."""
    confidence: Float[Tensor, "hand landmark=21"] | None = None
    """Detector confidence, 0 to 1; NaN where unknown."""
    intrinsics: Float[Tensor, "hand 3 3"] | None = None
    """Camera matrices, pixels of the image; None if the cameras are unknown."""
    images: tuple[Path | None, ...] = field(default=())
    """Image file of each hand, where the file names one; as many as `names`."""
    hand_boxes: Float[Tensor, "hand 4"] | None = None
    """Annotated box of each hand: left, top, right and bottom, pixels; NaN where unknown."""
    occluded: Bool[Tensor, "hand landmark=21"] | None = None
    """True for labelled landmarks that cannot be seen; None if the file does not specify it."""
    image_sizes: Float[Tensor, "hand 2"] | None = None
    """Width and height of each hand's image as the file gives them, pixels; NaN where unknown."""
    estimate: HandEstimate | None = None
    """A network's estimate of each hand, σ in pixels of the image; of the mirrored hand for a left one."""

    def __post_init__(self) -> None:
        if not self.images:
            object.__setattr__(self, "images", (None,) * len(self.names))
        lengths = {len(self.landmarks_2d), len(self.names), len(self.images)}
        if lengths != {len(self.landmarks_2d)}:
            raise ValueError(
                f"{len(self.landmarks_2d)} hands have {len(self.names)} names and "
                f"{len(self.images)} images; expected one of each per hand."
            )

    def __len__(self) -> int:
        return len(self.names)

    @property
    def usable(self) -> Bool[Tensor, " hand"]:
        """True for hands with `FEWEST` or more labelled landmarks that do not all coincide."""
        low, high = boxes(self)
        return (self.labelled.sum(dim=-1) >= FEWEST) & ((high - low).amax(dim=-1) > 0)

    def select(self, hands: slice | Tensor) -> "ImageLandmarks":
        """Some of the hands.

        Args:
            hands: A slice, a mask over the hands or their positions.
        """
        chosen = torch.arange(len(self))[hands].tolist()
        return replace(
            self,
            landmarks_2d=self.landmarks_2d[chosen],
            labelled=self.labelled[chosen],
            left=self.left[chosen],
            names=tuple(self.names[hand] for hand in chosen),
            sigma=None if self.sigma is None else self.sigma[chosen],
            confidence=None if self.confidence is None else self.confidence[chosen],
            intrinsics=None if self.intrinsics is None else self.intrinsics[chosen],
            images=tuple(self.images[hand] for hand in chosen),
            hand_boxes=None if self.hand_boxes is None else self.hand_boxes[chosen],
            occluded=None if self.occluded is None else self.occluded[chosen],
            image_sizes=None if self.image_sizes is None else self.image_sizes[chosen],
            estimate=None
            if self.estimate is None
            else self.estimate.select(torch.tensor(chosen).long()),
        )

    def parts(self, size: int) -> Iterator["ImageLandmarks"]:
        """Consecutive parts of at most `size` hands."""
        for start in range(0, len(self), size):
            yield self.select(slice(start, start + size))


def boxes(
    landmarks: ImageLandmarks,
) -> tuple[Float[Tensor, "hand 2"], Float[Tensor, "hand 2"]]:
    """Smallest and largest coordinates of the labelled landmarks, pixels.

    A hand without labelled landmarks has a box of zero size at its image's origin.
    """
    labelled = landmarks.labelled[..., None]
    low = torch.where(labelled, landmarks.landmarks_2d, torch.inf).amin(dim=1)
    high = torch.where(labelled, landmarks.landmarks_2d, -torch.inf).amax(dim=1)
    seen = landmarks.labelled.any(dim=1)[:, None]
    return torch.where(seen, low, 0.0), torch.where(seen, high, 0.0)


def mirror_matrices(
    landmarks: ImageLandmarks, which: Bool[Tensor, " hand"]
) -> Float[Tensor, "hand 3 3"]:
    """Matrices from image pixels to mirrored image pixels for some hands, the identity for the others.

    The axis goes through the principal point where the camera is known, so that the mirrored camera is the
    same one, and through the middle of the landmarks' box where it is not. Mirrored landmarks have the same
    axis: the matrices are their own inverse.
    """
    if landmarks.intrinsics is not None:
        axis = landmarks.intrinsics[:, 0, 2]
    else:
        low, high = boxes(landmarks)
        axis = (low[:, 0] + high[:, 0]) / 2
    matrices = torch.eye(3, dtype=axis.dtype).repeat(len(landmarks), 1, 1)
    matrices[:, 0, 0] = torch.where(which, -1.0, 1.0)
    matrices[:, 0, 2] = torch.where(which, 2 * axis, 0.0)
    return matrices


def mirror(landmarks: ImageLandmarks, which: Bool[Tensor, " hand"]) -> ImageLandmarks:
    """Mirror some hands: left ones become right ones and the other way round.

    The camera's x axis is negated too, so that a mirrored hand in 3D projects to its mirrored landmarks.
    Mirroring twice restores the original. Image files are not changed.
    """
    matrices = mirror_matrices(landmarks, which)
    intrinsics = landmarks.intrinsics
    return replace(
        landmarks,
        landmarks_2d=move_points(landmarks.landmarks_2d, matrices),
        left=landmarks.left ^ which,
        intrinsics=None if intrinsics is None else mirror_camera(matrices @ intrinsics, which),
        hand_boxes=_mirrored_boxes(landmarks.hand_boxes, matrices),
    )


def _mirrored_boxes(
    hand_boxes: Float[Tensor, "hand 4"] | None, matrices: Float[Tensor, "hand 3 3"]
) -> Float[Tensor, "hand 4"] | None:
    """Boxes after mirroring, with left and right edges in order."""
    if hand_boxes is None:
        return None
    corners = move_points(hand_boxes.unflatten(-1, (2, 2)), matrices)
    return torch.cat([corners.amin(dim=1), corners.amax(dim=1)], dim=-1)


def mirror_left(landmarks: ImageLandmarks) -> ImageLandmarks:
    """All hands as right hands; `mirror(result, landmarks.left)` undoes it."""
    return mirror(landmarks, landmarks.left)


def mirror_camera(
    matrices: Float[Tensor, "hand *rows 3"], which: Bool[Tensor, " hand"]
) -> Float[Tensor, "hand *rows 3"]:
    """Negate x in the camera frame of some hands: in points, or in matrices that are applied to points."""
    sign = torch.ones(len(which), 3, dtype=matrices.dtype, device=matrices.device)
    sign[which.to(matrices.device), 0] = -1.0
    return matrices * sign.reshape(len(which), *(1,) * (matrices.ndim - 2), 3)
