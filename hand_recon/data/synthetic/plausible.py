"""Penetration test for sampled poses, with capsules around the bones of the landmarks.

Capsules are coarse but a thousand times cheaper than the surface, and independent of the non-penetration
term, which is evaluated on synthetic hands.
"""

from typing import Final

import numpy as np
from jaxtyping import Float, Int

from hand_recon.data.synthetic.planes import length

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
_STARTS: Final = np.array([segment[0] for segment in _SEGMENTS])[_PAIRS.T]
_ENDS: Final = np.array([segment[1] for segment in _SEGMENTS])[_PAIRS.T]
_RADII: Final = np.array([segment[2] for segment in _SEGMENTS])[_PAIRS].sum(axis=1)
"""Landmarks at the starts and ends of both segments of each pair, and the sum of their radii."""


def deepest_overlap(landmarks: Float[np.ndarray, "landmark=21 3"]) -> float:
    """Largest penetration depth of any two capsules, metres; negative if all are apart.

    Args:
        landmarks: Metres, any frame.
    """
    points = np.ascontiguousarray(landmarks.T)
    starts, ends = points[:, _STARTS], points[:, _ENDS]
    distance = _segment_distance(starts[:, 0], ends[:, 0], starts[:, 1], ends[:, 1])
    return float((_RADII - distance).max())


def _segment_distance(
    start: Float[np.ndarray, "3 pair"],
    end: Float[np.ndarray, "3 pair"],
    other_start: Float[np.ndarray, "3 pair"],
    other_end: Float[np.ndarray, "3 pair"],
) -> Float[np.ndarray, " pair"]:
    """Distance of pairs of segments (Ericson, Real-Time Collision Detection, 2005, Sec. 5.1.9)."""
    along, other, between = end - start, other_end - other_start, start - other_start
    a, e = (along * along).sum(axis=0), (other * other).sum(axis=0)
    b, c, f = (
        (along * other).sum(axis=0),
        (along * between).sum(axis=0),
        (other * between).sum(axis=0),
    )
    determinant = np.maximum(a * e - b * b, 1e-15)
    s = _share((b * f - c * e) / determinant)
    t = _share((b * s + f) / e)
    s = _share((b * t - c) / a)
    return length(between + s * along - t * other)


def _share(value: Float[np.ndarray, " pair"]) -> Float[np.ndarray, " pair"]:
    return np.asarray(np.minimum(np.maximum(value, 0), 1))
