"""Penetration test for sampled poses, with capsules around the bones of the landmarks.

Capsules are coarse but a thousand times cheaper than the surface, and independent of the non-penetration
term, which is evaluated on synthetic hands.
"""

from typing import Final

import numpy as np
from jaxtyping import Float, Int

_SEGMENTS: Final = tuple(
    (start, end, radius)
    for finger in range(5)
    for start, end, radius in (
        (1 + 4 * finger, 2 + 4 * finger, 0.016 if finger == 0 else 0.0085),
        (2 + 4 * finger, 3 + 4 * finger, 0.009 if finger == 0 else 0.0075),
        (3 + 4 * finger, 4 + 4 * finger, 0.008 if finger == 0 else 0.0065),
    )
) + tuple((0, 5 + 4 * finger, 0.017) for finger in range(4))
"""End landmarks and radius (metres) of each capsule: three bones per finger, then the metacarpals.

The metacarpals' radius includes the flesh of the palm, which fingertips touch.
"""


def _pairs() -> Int[np.ndarray, "pair 2"]:
    """Pairs of bones to test: of different fingers, not both proximal, not at the base of the thumb."""
    found = []
    for first in range(len(_SEGMENTS)):
        for second in range(first + 1, len(_SEGMENTS)):
            both = {
                first // 3 if first < 15 else 10 + first,
                second // 3 if second < 15 else 10 + second,
            }
            root = first % 3 == 0 and (second >= 15 or second % 3 == 0)
            own_palm = second >= 15 and first // 3 == second - 14 and first % 3 == 1
            thumb_web = first == 1 and second in (3, 15)
            if len(both) == 2 and not (root or own_palm or thumb_web or first >= 15):
                found.append((first, second))
    return np.array(found)


_PAIRS: Final = _pairs()
_STARTS: Final = np.array([segment[0] for segment in _SEGMENTS])
_ENDS: Final = np.array([segment[1] for segment in _SEGMENTS])
_RADII: Final = np.array([segment[2] for segment in _SEGMENTS])


def deepest_overlap(landmarks: Float[np.ndarray, "landmark=21 3"]) -> float:
    """Largest penetration depth of any two capsules, metres; negative if all are apart.

    Args:
        landmarks: Metres, any frame.
    """
    first, second = _PAIRS.T
    distance = _segment_distance(
        landmarks[_STARTS[first]], landmarks[_ENDS[first]],
        landmarks[_STARTS[second]], landmarks[_ENDS[second]],
    )  # fmt: skip
    return float((_RADII[first] + _RADII[second] - distance).max())


def _segment_distance(
    start: Float[np.ndarray, "pair 3"],
    end: Float[np.ndarray, "pair 3"],
    other_start: Float[np.ndarray, "pair 3"],
    other_end: Float[np.ndarray, "pair 3"],
) -> Float[np.ndarray, " pair"]:
    """Distance of pairs of segments (Ericson, Real-Time Collision Detection, 2005, Sec. 5.1.9)."""
    along, other, between = end - start, other_end - other_start, start - other_start
    a, e = (along**2).sum(axis=1), (other**2).sum(axis=1)
    b, c, f = (
        (along * other).sum(axis=1),
        (along * between).sum(axis=1),
        (other * between).sum(axis=1),
    )
    determinant = np.maximum(a * e - b * b, 1e-15)
    s = np.clip((b * f - c * e) / determinant, 0, 1)
    t = np.clip((b * s + f) / e, 0, 1)
    s = np.clip((b * t - c) / a, 0, 1)
    nearest = between + s[:, None] * along - t[:, None] * other
    return np.asarray(np.linalg.norm(nearest, axis=1))
