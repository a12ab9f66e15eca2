"""Rotated squares of an image: cut out for a network, placed by a palm, by landmarks or by a box.

The rules and constants are MediaPipe's (modules/hand_landmark and calculators/util of version 0.10.21).
Decision 53 says where they differ from those of its Tasks API. Crops are sampled corner to corner: pixel 0 of
the image and of a crop are the same point if the crop is the image, whatever its size.
"""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from jaxtyping import Float, UInt8

PALM_SCALE: Final = 2.6
"""Side of a hand's square, in longer sides of the palm's box."""

PALM_OFFSET: Final = -0.5
"""Offset of that square along the palm's downward axis, in heights of the palm's box."""

LANDMARK_SCALE: Final = 2.0
"""Side of a hand's square, in longer sides of the rotated box around `STABLE_LANDMARKS`."""

LANDMARK_OFFSET: Final = -0.1
"""Offset of that square along the hand's downward axis, in heights of that box."""

STABLE_LANDMARKS: Final = (0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18)
"""Landmarks of palm and lower fingers, by which a hand is followed."""

WRIST: Final = 0
INDEX_MCP, MIDDLE_MCP, RING_MCP = 5, 9, 13


@dataclass(frozen=True)
class Region:
    """A square of an image, rotated about its centre."""

    x: float
    """Horizontal position of the centre, pixels."""
    y: float
    """Vertical position of the centre, pixels."""
    side: float
    """Length of a side, pixels."""
    rotation: float = 0.0
    """Angle from the image's axes to the square's, radians, clockwise as seen."""
    mirrored: bool = False
    """True if the crop is reversed from left to right after the rotation."""

    @property
    def axes(self) -> Float[np.ndarray, "2 2"]:
        """Directions of the crop's axes in the image, as columns of length 1."""
        cosine, sine = math.cos(self.rotation), math.sin(self.rotation)
        across = -1.0 if self.mirrored else 1.0
        return np.array([[across * cosine, -sine], [across * sine, cosine]])

    def crop_to_image(self, size: int) -> Float[np.ndarray, "2 3"]:
        """Affine map from pixels of a crop of this square to pixels of the image, corner to corner.

        Args:
            size: Side of the crop, pixels.
        """
        axes = self.side / size * self.axes
        origin = np.array([self.x, self.y]) - axes @ np.array([size / 2, size / 2])
        return np.column_stack([axes, origin])

    def crop(
        self,
        image: UInt8[np.ndarray, "height width 3"],
        size: int,
        border: int = cv2.BORDER_REPLICATE,
    ) -> UInt8[np.ndarray, "size size 3"]:
        """Cut the square out of an image by bilinear interpolation, without smoothing, as MediaPipe does.

        Args:
            image: RGB, bytes.
            size: Side of the crop, pixels.
            border: OpenCV's border mode, for the parts of the square outside the image.
        """
        matrix = np.vstack([self.crop_to_image(size), [0.0, 0.0, 1.0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        crop = cv2.warpPerspective(image, matrix, (size, size), flags=flags, borderMode=border)
        return np.asarray(crop, dtype=np.uint8)


def region_of_image(height: int, width: int, padding: float = 1.0) -> Region:
    """The upright square around a whole image, for the palm network.

    Args:
        height: Height of the image, pixels.
        width: Its width, pixels.
        padding: Side of the square, in longer sides of the image; rounded down to whole pixels.
    """
    side = int(padding * max(height, width))
    left, top = (side - width) // 2, (side - height) // 2
    if padding == 1.0:
        return Region(width / 2, height / 2, float(side))
    # The image is at whole pixels of a padded copy, as if that copy had been made.
    return Region(side / 2 - left, side / 2 - top, float(side))


def region_of_palm(
    box: Float[np.ndarray, "4"], wrist: Float[np.ndarray, "2"], middle_mcp: Float[np.ndarray, "2"]
) -> Region:
    """The square around a whole hand, from its palm.

    Args:
        box: Left, top, right and bottom of the palm, pixels.
        wrist: Position of the wrist, pixels.
        middle_mcp: Position of the middle finger's MCP, pixels.
    """
    left, top, right, bottom = (float(value) for value in box)
    rotation = upright_rotation(wrist, middle_mcp)
    offset = PALM_OFFSET * (bottom - top)
    return Region(
        (left + right) / 2 - offset * math.sin(rotation),
        (top + bottom) / 2 + offset * math.cos(rotation),
        PALM_SCALE * max(right - left, bottom - top),
        rotation,
    )


def region_of_landmarks(landmarks: Float[np.ndarray, "landmark=21 2"]) -> Region:
    """The square around a hand whose landmarks are known, for a second look or the next frame.

    Args:
        landmarks: Landmarks, pixels.
    """
    target = (landmarks[INDEX_MCP] + landmarks[RING_MCP]) / 4 + landmarks[MIDDLE_MCP] / 2
    rotation = upright_rotation(landmarks[WRIST], target)
    points = landmarks[list(STABLE_LANDMARKS)]
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    cosine, sine = math.cos(rotation), math.sin(rotation)
    # Columns are the square's axes: `rows @ axes` are coordinates along them.
    axes = np.array([[cosine, -sine], [sine, cosine]])
    along = (points - middle) @ axes
    low, high = along.min(axis=0), along.max(axis=0)
    width, height = (high - low).tolist()
    inside = (low + high) / 2 + np.array([0.0, LANDMARK_OFFSET * height])
    x, y = (middle + axes @ inside).tolist()
    return Region(x, y, LANDMARK_SCALE * max(width, height), rotation)


def upright_rotation(wrist: Float[np.ndarray, "2"], target: Float[np.ndarray, "2"]) -> float:
    """Rotation of a square in which the fingers point up, radians in [−π, π).

    MediaPipe's Tasks API means the same angle, but reads 90 degrees as 90 radians (decision 53).

    Args:
        wrist: Position of the wrist, pixels.
        target: Position of the MCPs' middle, pixels.
    """
    x, y = (target - wrist).tolist()
    rotation = math.pi / 2 - math.atan2(-y, x)
    return rotation - 2 * math.pi * math.floor((rotation + math.pi) / (2 * math.pi))
