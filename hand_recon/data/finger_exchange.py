"""Photographs of hands in new poses: a finger of one photograph is replaced by that of another.

Photographs of many people are not many poses. A network that has seen sixteen gestures pulls every other
combination of fingers to the nearest of them. A donor is a photograph whose palm is seen from the same
side, with skin of the same colour in the same light; its finger is turned and scaled with its palm onto
the other palm.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from hand_recon.hand.skeleton import LANDMARKS

Pixels = UInt8[np.ndarray, "height width 3"]
Points = Float[np.ndarray, "landmark=21 2"]

PALM: Final = tuple(
    i for i, name in enumerate(LANDMARKS) if name == "wrist" or (name.endswith("MCP") and i > 4)
)
"""Wrist and the MCPs of four fingers, by which palms are matched."""

FINGERS: Final = tuple(tuple(range(1 + 4 * finger, 5 + 4 * finger)) for finger in range(5))
"""Landmarks of each finger from its base to its tip, thumb first."""

_WRIST: Final = LANDMARKS.index("wrist")
_MIDDLE: Final = LANDMARKS.index("middle MCP")
_LITTLE: Final = LANDMARKS.index("little MCP")

STRAIGHT: Final = 0.85
"""Distance of a stretched finger's tip from its base, as a share of the length of its bones in the image."""

WIDTH: Final = 0.25
"""Width of a finger, as a share of the distance from the wrist to the middle MCP."""

DARKEST: Final = 12.0
"""Added to colours before their ratio is taken, so that noise in the dark does not count."""


@dataclass(frozen=True)
class Donors:
    """Hands whose fingers can be taken; all landmarks of each are labelled."""

    landmarks: Float[np.ndarray, "hand landmark=21 2"]
    """Pixels of the crops."""
    colours: Float[np.ndarray, "hand 3"]
    """Mean colour of each palm, 0 to 255."""


@dataclass(frozen=True)
class ExchangeRule:
    """Limits within which two hands are alike."""

    palm: float = 0.1
    """Largest mean distance of the donor's palm from the other, as a share of the palm's extent."""
    scales: tuple[float, float] = (0.5, 1.8)
    """Smallest and largest scale of a donor."""
    colour: float = 0.35
    """Largest difference of the logarithms of the palms' colours, in any channel."""
    change: float = 0.15
    """Smallest mean distance of the new finger from the old one, as a share of the palm's length."""


@dataclass(frozen=True)
class Similarity:
    """Similarity transforms of points, one per donor."""

    linear: Float[np.ndarray, "hand 2 2"]
    """Rotation times scale."""
    offset: Float[np.ndarray, "hand 2"]
    """Translation, pixels."""
    error: Float[np.ndarray, " hand"]
    """Mean distance that is left, as a share of the target's extent."""

    def __call__(
        self, points: Float[np.ndarray, "hand point 2"]
    ) -> Float[np.ndarray, "hand point 2"]:
        """Move points."""
        moved: np.ndarray = np.einsum("hij,hpj->hpi", self.linear, points) + self.offset[:, None]
        return moved


def straight_fingers(
    landmarks: Float[np.ndarray, "hand landmark=21 2"],
) -> Bool[np.ndarray, "hand finger=5"]:
    """True for each finger that is stretched, by its landmarks in the image, thumb first.

    A finger is stretched if its tip is nearly as far from its base as its bones are long, and farther
    from the wrist than its base; a thumb, if its tip is farther from the little finger's base than its IP.

    Args:
        landmarks: Pixels.
    """
    straight = np.empty((len(landmarks), 5), dtype=bool)
    for finger, joints in enumerate(FINGERS):
        chain = landmarks[:, list(joints)]
        if finger == 0:
            across = np.linalg.norm(chain[:, 2:] - landmarks[:, [_LITTLE]], axis=-1)
            straight[:, finger] = across[:, 1] > across[:, 0]
            continue
        bones = np.linalg.norm(np.diff(chain, axis=1), axis=-1).sum(axis=1)
        chord = np.linalg.norm(chain[:, 3] - chain[:, 0], axis=-1)
        from_wrist = np.linalg.norm(chain[:, [0, 3]] - landmarks[:, [_WRIST]], axis=-1)
        straight[:, finger] = (chord > STRAIGHT * bones) & (from_wrist[:, 1] > from_wrist[:, 0])
    return straight


def similarity(
    points: Float[np.ndarray, "hand point 2"], target: Float[np.ndarray, "point 2"]
) -> Similarity:
    """Least-squares similarity, without reflection, from each set of points to a target.

    In the plane, a similarity is a product with one complex number, whose least-squares value is
    closed-form.
    """
    mean, goal = points.mean(axis=1), target.mean(axis=0)
    centred = (points - mean[:, None]) @ np.array([1, 1j])
    wanted = (target - goal) @ np.array([1, 1j])
    factor = (centred.conj() * wanted).sum(axis=1)
    factor = factor / np.maximum((np.abs(centred) ** 2).sum(axis=1), 1e-9)
    error = np.abs(factor[:, None] * centred - wanted).mean(axis=1)
    linear = np.empty((len(points), 2, 2))
    linear[:, 0, 0] = linear[:, 1, 1] = factor.real
    linear[:, 1, 0], linear[:, 0, 1] = factor.imag, -factor.imag
    offset = goal - np.einsum("hij,hj->hi", linear, mean)
    return Similarity(linear, offset, error / max(float(np.abs(wanted).max()), 1e-9))


def choose_donor(
    donors: Donors,
    candidates: Int[np.ndarray, " candidate"],
    hand: int,
    landmarks: Points,
    *,
    finger: int,
    rule: ExchangeRule,
) -> tuple[int, Float[np.ndarray, "2 3"]] | None:
    """Choose the donor whose skin is most alike among those whose palm fits; None if none fits.

    Args:
        donors: All hands.
        candidates: Positions of the donors to choose from.
        hand: Position of the hand that gets the finger.
        landmarks: Its landmarks, perhaps with other fingers exchanged already.
        finger: The finger, 0 to 4, thumb first.
        rule: Limits.

    Returns:
        Its position, and the transform from its pixels to those of the hand.
    """
    chosen = donors.landmarks[candidates]
    palm = list(PALM)
    fits = similarity(chosen[:, palm], landmarks[palm])
    scale = np.sqrt(np.abs(np.linalg.det(fits.linear)))
    own = landmarks[list(FINGERS[finger])]
    length = np.linalg.norm(landmarks[_MIDDLE] - landmarks[_WRIST])
    moved = fits(chosen[:, list(FINGERS[finger])])
    change = np.linalg.norm(moved - own, axis=-1).mean(axis=1) / max(float(length), 1e-9)
    colours = np.log(donors.colours + DARKEST)
    unlike = np.abs(colours[candidates] - colours[hand]).max(axis=1)
    low, high = rule.scales
    possible = (fits.error < rule.palm) & (scale > low) & (scale < high)
    possible &= (change > rule.change) & (unlike < rule.colour) & (candidates != hand)
    if not possible.any():
        return None
    best = int(np.where(possible, unlike, np.inf).argmin())
    return int(candidates[best]), np.column_stack([fits.linear[best], fits.offset[best]])


def exchange_finger(
    image: Pixels,
    landmarks: Points,
    donor_image: Pixels,
    donor_landmarks: Points,
    *,
    finger: int,
    matrix: Float[np.ndarray, "2 3"],
) -> tuple[Pixels, Points]:
    """Replace a finger of a hand by a donor's.

    The old finger is painted over from its surroundings, except where other fingers are; the new one has the
    colour of the palm that it comes to.

    Args:
        image: Crop of the hand, RGB.
        landmarks: Its landmarks, pixels.
        donor_image: Crop of the donor.
        donor_landmarks: Its landmarks, pixels.
        finger: The finger, 0 to 4, thumb first.
        matrix: Transform from the donor's pixels to the hand's.
    """
    size = (image.shape[1], image.shape[0])
    width = WIDTH * float(np.linalg.norm(landmarks[_MIDDLE] - landmarks[_WRIST]))
    moved = donor_landmarks @ matrix[:, :2].T + matrix[:, 2]
    donor = cv2.warpAffine(donor_image, matrix, size, borderMode=cv2.BORDER_REPLICATE)
    ours, theirs = (
        palm_colour(pixels, points) for pixels, points in ((image, landmarks), (donor, moved))
    )
    donor = np.clip(donor * ((ours + DARKEST) / (theirs + DARKEST)), 0, 255).astype(np.uint8)
    bare = _without_finger(image, landmarks, finger, width)
    joints = moved[list(FINGERS[finger])]
    tip = joints[3] + 0.25 * (joints[3] - joints[2])
    base = joints[0] + 0.1 * (joints[1] - joints[0])
    shape = _stroke([base, *joints[1:], tip], np.array([0.95, 0.85, 0.78, 0.7]) * width, size)
    opacity = cv2.GaussianBlur(shape.astype(np.float32) / 255, (0, 0), 1.0)[..., None]
    pixels = (bare * (1 - opacity) + donor * opacity).astype(np.uint8)
    changed = landmarks.copy()
    changed[list(FINGERS[finger])] = joints
    return pixels, changed


def palm_colour(image: Pixels, landmarks: Points) -> Float[np.ndarray, "3"]:
    """Mean colour inside the convex hull of a palm, 0 to 255."""
    hull = cv2.convexHull(np.round(landmarks[list(PALM)]).astype(np.int32))
    mask = cv2.fillConvexPoly(np.zeros(image.shape[:2], np.uint8), hull, 255)
    return np.array(cv2.mean(image, mask)[:3])


def _without_finger(image: Pixels, landmarks: Points, finger: int, width: float) -> Pixels:
    """The image with a finger painted over from a third of its first bone on."""
    size = (image.shape[1], image.shape[0])
    joints = landmarks[list(FINGERS[finger])]
    start = joints[0] + 0.35 * (joints[1] - joints[0])
    mask = _stroke([start, *joints[1:]], np.array([1.0, 0.95, 0.85]) * width, size)
    mask = cv2.dilate(mask, np.ones((3, 3), np.uint8))
    for other in range(5):
        if other != finger:
            points = list(landmarks[list(FINGERS[other])])
            mask[_stroke(points, np.full(3, 0.7 * width), size) > 127] = 0
    return np.asarray(cv2.inpaint(image, (mask > 127).astype(np.uint8), 3, cv2.INPAINT_TELEA))


def _stroke(
    points: list[Float[np.ndarray, "2"]], widths: Float[np.ndarray, " bone"], size: tuple[int, int]
) -> UInt8[np.ndarray, "height width"]:
    """Mask, 0 to 255, of a line through points with a width for each part."""
    mask = np.zeros(size[::-1], np.uint8)
    # Four binary digits below a pixel.
    fixed = np.round(np.array(points) * 16).astype(int)
    for start, end, width in zip(fixed[:-1], fixed[1:], widths, strict=True):
        thickness = max(1, round(float(width)))
        cv2.line(mask, start.tolist(), end.tolist(), 255, thickness, cv2.LINE_AA, 4)
    return mask
