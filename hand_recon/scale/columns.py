"""Columns of Daft: images or landmarks in, hands out."""

from collections.abc import Sequence
from typing import Any, Final

from hand_recon.scale.settings import plain_settings
from hand_recon.scale.udfs import AuditsOfHands, HandsOfImages, HandsOfLandmarks, worker_column

BATCH: Final = 32
"""Images or hands that a worker gets at once."""


def reconstruct_hands(
    images: Any,  # noqa: ANN401  # daft.Expression
    *,
    intrinsics: Any = None,  # noqa: ANN401
    workers: int = 1,
    batch: int = BATCH,
    overrides: Sequence[str] = (),
) -> Any:  # noqa: ANN401  # daft.Expression
    """Find the hands of a column of images and reconstruct them; nothing runs before Daft does.

    An image that is null, damaged or otherwise impossible gives a row with `error`, and no hand.

    Args:
        images: Daft's images (decoded with `mode="RGB"`), bytes of files, names of files, or structs of
            `bytes` and `path`.
        intrinsics: Column of camera matrices, 3 × 3, pixels; none for the camera that `overrides` name.
        workers: Processes, each with networks of its own and one compute thread.
        batch: Images that a process gets at once.
        overrides: Settings of `hand-recon predict`, such as `camera=fov=60` or `detector.max_hands=2`.

    Returns:
        An expression of structs: `hands` (a list, empty without hands, null beside an error; its fields are
        in `hand_recon.scale.schema`), `width`, `height` and `error`.

    Raises:
        ModuleNotFoundError: Daft is not installed.
        ValueError: A setting is not known, or needs all images at once.
    """
    settings = plain_settings("predict", overrides)
    given = (images, intrinsics)
    return worker_column(HandsOfImages, settings, given, workers=workers, batch=batch)


def fit_hands(
    landmarks: Any,  # noqa: ANN401  # daft.Expression
    *,
    side: Any = "right",  # noqa: ANN401
    confidence: Any = None,  # noqa: ANN401
    intrinsics: Any = None,  # noqa: ANN401
    workers: int = 1,
    batch: int = BATCH,
    overrides: Sequence[str] = (),
) -> Any:  # noqa: ANN401  # daft.Expression
    """Fit hands to a column of 2D landmarks, one hand to a row.

    Args:
        landmarks: 21 × 2, pixels, in the order of MediaPipe; a missing point is null or NaN.
        side: `right` or `left`, or a column of these.
        confidence: Column of detector confidences, 21 numbers from 0 to 1; none if unknown.
        intrinsics: Column of camera matrices, 3 × 3, pixels; none for an assumed camera.
        workers: Processes, each with one compute thread.
        batch: Hands that a process gets at once.
        overrides: Settings of `hand-recon fit`, such as `prior=biomechanics`.

    Returns:
        An expression of structs: `hand` (null beside an error) and `error`.

    Raises:
        ModuleNotFoundError: Daft is not installed.
        ValueError: A setting is not known, or needs all hands at once.
    """
    settings = plain_settings("fit", overrides)
    given = (landmarks, side, confidence, intrinsics)
    return worker_column(HandsOfLandmarks, settings, given, workers=workers, batch=batch)


def audit_hands(
    landmarks: Any,  # noqa: ANN401  # daft.Expression
    *,
    side: Any = None,  # noqa: ANN401
    workers: int = 1,
    batch: int = BATCH,
    overrides: Sequence[str] = (),
) -> Any:  # noqa: ANN401  # daft.Expression
    """Audit a column of 3D landmarks, one hand to a row: how plausible the hands are.

    The unit and the landmark order of each hand are recognised by its size and its bones.

    Args:
        landmarks: 21 × 3, any unit and frame; a missing point is null or NaN.
        side: `right` or `left`, or a column of these; none to see it by the way fingers bend.
        workers: Processes, each with one compute thread.
        batch: Hands that a process gets at once.
        overrides: Settings of `hand-recon audit`, such as `landmark_set=mediapipe`.

    Returns:
        An expression of structs: `verdict`, `reasons`, `handedness`, measurements, `joint_angles_degrees`
        and `error`.

    Raises:
        ModuleNotFoundError: Daft is not installed.
        ValueError: A setting is not known.
    """
    settings = plain_settings("audit", overrides)
    given = (landmarks, side)
    return worker_column(AuditsOfHands, settings, given, workers=workers, batch=batch)
