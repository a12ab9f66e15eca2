"""Fits a set of landmarks part by part, so that the first hands are written while later ones are fitted."""

from collections.abc import Callable, Iterator, Sequence
from typing import Final

from hand_recon.data.landmarks.crops import to_crops
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.progress import with_progress
from hand_recon.fitting.fitted_hands import FittedHands, fitted_hands
from hand_recon.fitting.objective import Fitted
from hand_recon.fitting.origin import Origin
from hand_recon.schema import HandBatch

PART: Final = 64
"""Hands per part."""

Fitter = Callable[[HandBatch], Fitted]
"""From crops of landmarks to hands."""


def fit_in_parts(
    landmarks: ImageLandmarks,
    fitter: Fitter,
    size: int = PART,
    origins: Sequence[Origin] = (),
) -> Iterator[FittedHands]:
    """Yield the hands in order as they are fitted; hands with too few landmarks keep their positions.

    Args:
        landmarks: The hands' landmarks.
        fitter: Fits the hands of one part.
        size: Hands per part.
        origins: Origin of each hand; none for landmarks without further information.
    """
    parts = landmarks.parts(size)
    total = -(-len(landmarks) // size)
    done = 0
    for part in with_progress(parts, total, f"Fitting {len(landmarks)} hands, {size} at a time"):
        yield fit_part(part, fitter, tuple(origins[done : done + len(part)]))
        done += len(part)


def fit_part(part: ImageLandmarks, fitter: Fitter, origins: tuple[Origin, ...] = ()) -> FittedHands:
    """Fit the hands of one part, which is one batch; those with too few landmarks keep their positions.

    Args:
        part: The hands' landmarks.
        fitter: Fits them.
        origins: Origin of each hand; none for landmarks without further information.
    """
    crops, usable = to_crops(part), part.usable
    found = fitter(crops.batch.select(usable))
    # Without a loss, the hands are a lifter's predictions, with σ of its own; a fit has the given σ.
    is_lifter = not found.loss
    return fitted_hands(
        part, crops, found.prediction, found.loss, has_sigma=is_lifter, origins=origins
    )
