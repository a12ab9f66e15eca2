"""Records of hands with given landmarks, error bars and verdicts, and nothing else of interest."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from hand_recon.fitting.hand_records import SHAPES, HandRecords


def uncertain_hands(
    images: Sequence[str],
    landmarks_3d: Float[np.ndarray, "hand landmark=21 3"],
    covariance_3d: Float[np.ndarray, "hand landmark=21 3 3"],
    verdicts: Sequence[str] | None = None,
    sides: Sequence[str] | None = None,
) -> HandRecords:
    """Hands of images; those that are not fitted have no numbers.

    Args:
        images: Image of each hand.
        landmarks_3d: Landmarks, metres.
        covariance_3d: Their covariances, square metres.
        verdicts: Verdict on each hand, `plausible` by default; the others have a reason.
        sides: Side of each hand, `right` by default.
    """
    count = len(images)
    verdicts = verdicts or ["plausible"] * count
    numbers = {key: np.zeros((count, *shape)) for key, shape in SHAPES.items()}
    numbers |= {
        "landmarks_3d": landmarks_3d.copy(),
        "covariance_3d": covariance_3d.copy(),
        "translation": np.tile([0.0, 0.0, 0.5], (count, 1)),
        "intrinsics": np.tile(np.diag([500.0, 500.0, 1.0]), (count, 1, 1)),
        "sigma_2d": np.full((count, 21, 2), np.nan),
    }
    for key in ("landmarks_3d", "covariance_3d"):
        numbers[key][[verdict == "not fitted" for verdict in verdicts]] = np.nan
    return HandRecords(
        names=tuple(images),
        images=tuple(images),
        sides=tuple(sides or ["right"] * count),
        verdicts=tuple(verdicts),
        reasons=tuple(() if verdict == "plausible" else ("A reason.",) for verdict in verdicts),
        cameras=("given",) * count,
        image_sizes=(None,) * count,
        loss={},
        sources=("test",) * count,
        hand_models=("open",) * count,
        versions=("0",) * count,
        moments=(None,) * count,
        **numbers,
    )
