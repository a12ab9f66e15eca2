"""Square crops: pixels, labels and camera go through one matrix (Sec. 4.1).

Pixel i of a row covers [i, i + 1) and its centre is at i + 0.5, so an image w pixels wide spans
[0, w], the middle of a crop is at half its side and resizing is a pure scaling. A point (x, y, z)
of the camera's frame falls on u = f_x x / z + c_x in the same coordinates. OpenCV counts from pixel
centres; the half pixel is added and subtracted only in this module.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

POLICIES: Final = ("full", "centre", "joints", "box", "mask")
"""Choices of what a crop is made around: the whole image, its middle, the box of the labelled landmarks, the
dataset's own box, or the hand's largest piece in the dataset's mask."""

_FAR: Final = 4
"""Longest side of a region that is sampled at every pixel, as a multiple of the image's: without a bound, a
label far outside of the image would take any amount of memory."""

_FINEST: Final = 16_384
"""Most samples on a side of a region: 0.8 GB, and below what OpenCV can warp."""


@dataclass(frozen=True)
class Square:
    """The part of an image that becomes a crop."""

    centre: tuple[float, float]
    """Column and row of its middle, pixels of the image."""
    side: float
    """Length of a side, pixels of the image."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.centre).all() and np.isfinite(self.side) and self.side > 0):
            raise ValueError(
                f"A crop needs a finite centre and a positive side, found centre {self.centre} and "
                f"side {self.side}; look for landmarks that all coincide or are missing."
            )


@dataclass(frozen=True)
class HandRegion:
    """Position of a hand in its image: landmarks and, where known, box and mask."""

    landmarks: Float[np.ndarray, "landmark 2"]
    """Pixels of the image, NaN where not labelled."""
    box: Float[np.ndarray, " 4"] | None = None
    """Left, top, right and bottom, pixels of the image; NaN where unknown."""
    mask: Bool[np.ndarray, "height width"] | None = None
    """True where the hand is."""
    name: str = "this sample"
    """Name of the sample, for messages."""


@dataclass(frozen=True)
class CropPolicy:
    """Size and position of a dataset's crops.

    Raises:
        ValueError: The policy is unknown, or the crop would be empty.
    """

    size: int = 224
    """Side of the crop, pixels."""
    around: str = "full"
    """One of `POLICIES`."""
    expansion: float = 1.5
    """Side of a crop around landmarks, box or mask, as a multiple of the longer side of their box."""
    centre_side: float = 130.0
    """Side of a crop `around=centre`, pixels of the image (MobRecon's FreiHAND test: 100 × 1.3)."""

    def __post_init__(self) -> None:
        if self.around not in POLICIES:
            raise ValueError(f"Unknown crop {self.around!r}; choose one of {list(POLICIES)}.")
        if self.size < 1 or not self.expansion > 0 or not self.centre_side > 0:
            raise ValueError(
                f"A crop of {self.size} pixels at expansion {self.expansion} (or of {self.centre_side} "
                "pixels of the image) shows nothing; all must be positive."
            )

    def matrix(self, image_size: tuple[int, int], region: HandRegion) -> Float[np.ndarray, "3 3"]:
        """Matrix from image pixels to crop pixels, for one image.

        Args:
            image_size: Height and width, pixels.
            region: Position of the hand.

        Raises:
            ValueError: The dataset has no box or mask that the crop should be made around.
        """
        return crop_matrix(self._square(image_size, region), self.size)

    def _square(self, image_size: tuple[int, int], region: HandRegion) -> Square:
        height, width = image_size
        if self.around == "full":
            return whole_image(height, width)
        if self.around == "centre":
            return Square((width / 2, height / 2), self.centre_side)
        if self.around == "joints":
            return around_landmarks(region.landmarks, self.expansion)
        if self.around == "box":
            if region.box is None or not np.isfinite(region.box).all():
                raise ValueError(_nothing_to_cut(region, "no box"))
            left, top, right, bottom = region.box.tolist()
            return around_box((left, top, right, bottom), self.expansion)
        if region.mask is None or not region.mask.any():
            raise ValueError(_nothing_to_cut(region, "no mask, or an empty one"))
        return around_box(mask_box(region.mask), self.expansion)


def _nothing_to_cut(region: HandRegion, missing: str) -> str:
    return (
        f"{region.name} has {missing} to cut a crop around. Choose another crop: data.crop.around=joints, or "
        "for FreiHAND's evaluation images data.test_crop.around=centre."
    )


def mask_box(mask: Bool[np.ndarray, "height width"]) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of a mask's largest connected piece, pixels."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    # Row 0 is the background.
    left, top, width, height, _ = stats[1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())].tolist()
    return float(left), float(top), float(left + width), float(top + height)


def crop_mirror(crop_size: int) -> Float[np.ndarray, "3 3"]:
    """Matrix from a crop's pixels to those of its horizontal mirror image."""
    return np.array([[-1.0, 0.0, float(crop_size)], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def whole_image(height: int, width: int) -> Square:
    """The smallest square about the middle that holds the image."""
    return Square(centre=(width / 2, height / 2), side=float(max(height, width)))


def around_landmarks(landmarks: Float[np.ndarray, "landmark 2"], expansion: float = 1.5) -> Square:
    """The square about the landmarks' bounding box.

    Args:
        landmarks: Pixels of the image; those that are NaN are left out.
        expansion: Side of the square as a multiple of the box's longer side.

    Raises:
        ValueError: Fewer than two landmarks are labelled, or they coincide.
    """
    labelled = landmarks[np.isfinite(landmarks).all(axis=-1)]
    if len(labelled) < 2:
        raise ValueError(
            f"A crop around landmarks needs two or more that are labelled, found {len(labelled)}; "
            "use crop=full for this dataset, or leave the sample out."
        )
    left, top = labelled.min(axis=0).tolist()
    right, bottom = labelled.max(axis=0).tolist()
    return around_box((left, top, right, bottom), expansion)


def around_box(box: tuple[float, float, float, float], expansion: float = 1.0) -> Square:
    """The square about a box.

    Args:
        box: Left, top, right and bottom, pixels of the image.
        expansion: Side of the square as a multiple of the box's longer side.
    """
    left, top, right, bottom = box
    side = max(right - left, bottom - top) * expansion
    return Square(centre=((left + right) / 2, (top + bottom) / 2), side=side)


def crop_matrix(square: Square, crop_size: int, rotation: float = 0.0) -> Float[np.ndarray, "3 3"]:
    """Matrix from image pixels to crop pixels.

    Args:
        square: Part of the image to cut out.
        crop_size: Side of the crop, pixels.
        rotation: Rotation of the content about the crop's middle, from x towards y (clockwise), radians.
    """
    scale = crop_size / square.side
    cosine, sine = scale * np.cos(rotation), scale * np.sin(rotation)
    linear = np.array([[cosine, -sine], [sine, cosine]])
    matrix = np.eye(3)
    matrix[:2, :2] = linear
    matrix[:2, 2] = crop_size / 2 - linear @ np.array(square.centre)
    return matrix


def crop_points(
    points: Float[np.ndarray, "*batch 2"], matrix: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "*batch 2"]:
    """Convert points from image pixels to crop pixels; NaN stays NaN."""
    return np.asarray(points @ matrix[:2, :2].T + matrix[:2, 2])


def crop_intrinsics(
    intrinsics: Float[np.ndarray, "3 3"], matrix: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "3 3"]:
    """Camera matrix of the crop: the image's matrix followed by the crop's."""
    return np.asarray(matrix @ intrinsics)


def crop_image(
    image: UInt8[np.ndarray, "height width 3"], matrix: Float[np.ndarray, "3 3"], crop_size: int
) -> UInt8[np.ndarray, "{crop_size} {crop_size} 3"]:
    """Cut a crop out of an image, black where there is no image.

    Where the crop is smaller than the region that it shows, pixels are averaged, so that thin fingers
    stay connected; more coarsely in a region several times as large as the image.

    Args:
        image: Image of any three channels.
        matrix: Matrix from image pixels to crop pixels, of `crop_matrix`.
        crop_size: Side of the crop, pixels.
    """
    with np.errstate(divide="ignore"):
        shrinks = 1 / np.sqrt(abs(np.linalg.det(matrix[:2, :2])))
    if _is_plain_resize(image, matrix, crop_size):
        method = cv2.INTER_AREA if shrinks > 1 else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(image, (crop_size, crop_size), interpolation=method))
    finest = min(_FAR * max(image.shape[:2]), _FINEST) // crop_size
    oversampling = max(1, int(min(np.ceil(shrinks), finest)))
    finer = np.diag([oversampling, oversampling, 1.0]) @ matrix
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    from_centres = np.linalg.inv(half) @ finer @ half
    size = (crop_size * oversampling, crop_size * oversampling)
    crop = cv2.warpAffine(image, from_centres[:2], size, flags=cv2.INTER_LINEAR)
    if oversampling > 1:
        crop = cv2.resize(crop, (crop_size, crop_size), interpolation=cv2.INTER_AREA)
    return np.asarray(crop)


def _is_plain_resize(
    image: UInt8[np.ndarray, "height width 3"], matrix: Float[np.ndarray, "3 3"], crop_size: int
) -> bool:
    """True if the crop is the whole of a square image, so that its border needs no black outside."""
    height, width = image.shape[:2]
    scale = crop_size / width
    return height == width and bool(np.allclose(matrix, np.diag([scale, scale, 1]), atol=1e-9))
