"""Checks of known cameras: against the image's size, and by the position of the hand (decision 59)."""

from collections.abc import Sequence
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.data.landmarks.image_landmarks import boxes
from hand_recon.fitting.doubts.reasons import Reasons, reasons
from hand_recon.fitting.fitted_hands import FittedHands

GREATEST_ANGLE: Final = 60.0
"""Greatest angle between the ray to the hand and the optical axis, degrees."""

DEPTHS: Final = (0.08, 10.0)
"""Depth of a hand's origin before a known camera, metres."""

FOCAL_LENGTHS: Final = (0.2, 20.0)
"""Focal length as a multiple of the image's longer side."""

OTHER_SIZE: Final = (0.7, 1.4)
"""Principal point over the image's centre: outside of this, and equal for both axes within `SAME_SHARE`, the
matrix is one of an image of another size."""

SAME_SHARE: Final = 0.05
"""Difference of the two ratios, relative to their mean, up to which they are equal."""

SMALLEST_SHARE: Final = 0.05
"""Least such ratio of an image of another size; below it, the principal point is the image's corner."""

GREATEST_ASPECT: Final = 1.2
"""Greatest ratio of the two focal lengths."""


def camera_doubts(
    hands: FittedHands, image_sizes: Sequence[tuple[int, int] | None]
) -> dict[str, Reasons]:
    """Check cameras, and that landmarks are inside the image.

    Args:
        hands: Fitted hands.
        image_sizes: Width and height of each image, pixels; None where unknown.
    """
    sizes = torch.tensor(
        [(torch.nan, torch.nan) if size is None else size for size in image_sizes],
        dtype=torch.float64,
    ).reshape(-1, 2)
    found = {"outside the image": _outside(hands, sizes)}
    if hands.observed.intrinsics is not None:
        matrices = hands.observed.intrinsics.double()
        doubts = _matrix_doubts(matrices, sizes) | _position_doubts(hands, matrices)
        # An assumed camera says nothing about distances, even where a matrix was made of it.
        known = {
            hand
            for hand, origin in enumerate(hands.origins)
            if origin.camera not in ("assumed", "none")
        }
        found |= {
            name: {hand: sentence for hand, sentence in those.items() if hand in known}
            for name, those in doubts.items()
        }
    return found


def _outside(hands: FittedHands, sizes: Float[Tensor, "hand 2"]) -> Reasons:
    """Find hands with most of their landmarks outside the image."""
    points, labelled = hands.observed.landmarks_2d, hands.observed.labelled
    outside = ((points < 0) | (points > sizes[:, None])).any(dim=-1)
    count = (outside & labelled & sizes.isfinite().all(dim=1, keepdim=True)).sum(dim=1)
    return reasons(
        2 * count > labelled.sum(dim=1),
        lambda hand: (
            f"{int(count[hand])} of {int(labelled[hand].sum())} landmarks are outside the image of "
            f"{_size(sizes[hand])} pixels, expected less than half: check that they belong to this image, at "
            "this size and orientation."
        ),
    )


def _matrix_doubts(
    matrices: Float[Tensor, "hand 3 3"], sizes: Float[Tensor, "hand 2"]
) -> dict[str, Reasons]:
    """Compare camera matrices with the size of their images."""
    focal, centre = matrices[:, [0, 1], [0, 1]], matrices[:, :2, 2]
    longer = sizes.amax(dim=1)
    relative = focal.mean(dim=1) / longer
    aspect = focal.amax(dim=1) / focal.amin(dim=1)
    share = centre / (sizes / 2)
    alike = (share[:, 0] - share[:, 1]).abs() <= SAME_SHARE * share.mean(dim=1)
    scaled = ((share < OTHER_SIZE[0]) | (share > OTHER_SIZE[1])).all(dim=1) & alike
    scaled &= (share > SMALLEST_SHARE).all(dim=1)
    outside = ((centre <= 0) | (centre >= sizes)).any(dim=1) & ~scaled & longer.isfinite()
    return {
        "focal length": reasons(
            (relative < FOCAL_LENGTHS[0]) | (relative > FOCAL_LENGTHS[1]),
            lambda hand: (
                f"The focal length is {float(focal[hand].mean()):.3g} pixels for an image of "
                f"{_size(sizes[hand])}, expected {FOCAL_LENGTHS[0]} to {FOCAL_LENGTHS[1]:.0f} times its "
                "longer side: give the camera matrix in pixels of the image."
            ),
        ),
        "other image size": reasons(
            scaled,
            lambda hand: (
                f"The principal point is the centre of an image of {_size(2 * centre[hand])}, and this image "
                f"has {_size(sizes[hand])} pixels: scale the camera matrix to the image."
            ),
        ),
        "principal point": reasons(
            outside,
            lambda hand: (
                f"The principal point {_point(centre[hand])} is outside the image of {_size(sizes[hand])} "
                "pixels: give the camera matrix in pixels of this image."
            ),
        ),
        "aspect": reasons(
            aspect > GREATEST_ASPECT,
            lambda hand: (
                f"The focal lengths {_point(focal[hand])} differ by a factor of {float(aspect[hand]):.2f}, "
                f"expected at most {GREATEST_ASPECT}: check that both are in pixels of the image."
            ),
        ),
    }


def _position_doubts(hands: FittedHands, matrices: Float[Tensor, "hand 3 3"]) -> dict[str, Reasons]:
    """Check the direction and the depth of hands before known cameras."""
    low, high = boxes(hands.observed)
    middle = torch.cat([(low + high) / 2, torch.ones_like(low[:, :1])], dim=1).double()
    ray = torch.linalg.solve(matrices, middle[..., None])[..., 0]
    angle = torch.atan(ray[:, :2].norm(dim=1)).rad2deg()
    depth = hands.prediction.parameters.translation[:, 2]
    nearest = hands.prediction.landmarks_3d[..., 2].amin(dim=1)
    return {
        "angle": reasons(
            angle > GREATEST_ANGLE,
            lambda hand: (
                f"The hand is {float(angle[hand]):.0f}° from the optical axis of this camera, expected below "
                f"{GREATEST_ANGLE:.0f}°: give the camera matrix in pixels of the image."
            ),
        ),
        "depth": reasons(
            (depth < DEPTHS[0]) | (depth > DEPTHS[1]) | (nearest <= 0),
            lambda hand: (
                f"The hand is at a depth of {float(depth[hand]):.2g} m, its nearest landmark at "
                f"{float(nearest[hand]):.2g} m, expected {DEPTHS[0]} to {DEPTHS[1]:.0f} m: check the camera "
                "matrix."
            ),
        ),
    }


def _size(size: Float[Tensor, " 2"]) -> str:
    width, height = size.tolist()
    return f"{width:.0f}×{height:.0f}"


def _point(point: Float[Tensor, " 2"]) -> str:
    u, v = point.tolist()
    return f"({u:.4g}, {v:.4g})"
