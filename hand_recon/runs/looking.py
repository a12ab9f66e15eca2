"""Finds the hands of photographs, and makes landmarks to fit of them."""

import itertools
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from omegaconf import DictConfig

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.photos.formats import PhotoError
from hand_recon.data.photos.photo import Photo, read_photo
from hand_recon.detection.detector import DetectedHand, Detector
from hand_recon.fitting.origin import Origin
from hand_recon.fitting.photo_camera import CameraChoice, with_given_camera
from hand_recon.runs.configuration import instantiate
from hand_recon.runs.given_boxes import GivenBoxes, WholeImages
from hand_recon.runs.landmark_lookup import FileLandmarks
from hand_recon.runs.photo_checkpoint import gives_boxes_alone
from hand_recon.runs.photo_network import PhotoNetwork
from hand_recon.schema import HandEstimate

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class LookedAt:
    """A photograph in which hands were looked for."""

    number: int
    """Index among all photographs of the command."""
    name: str
    """Name by which results refer to it."""
    path: Path | None = None
    """File; None for an image that was given as an array."""
    size: tuple[int, int] | None = None
    """Width and height, pixels; None if it could not be read."""
    hands: tuple[DetectedHand, ...] = ()
    """Hands that were found."""
    camera: Float[np.ndarray, "3 3"] | None = None
    """Camera matrix, pixels; None if the photograph could not be read."""
    camera_source: str = "assumed"
    """Source of the camera matrix."""
    estimate: HandEstimate | None = None
    """A network's estimate of each hand, σ in pixels; None without a network or without hands."""
    error: str | None = None
    """Reason why the photograph could not be processed; None if it was."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Time of each stage, `read`, `detect` and `fit`."""

    def with_time(self, stage: str, seconds: float) -> "LookedAt":
        """The same with the time of one more stage."""
        return replace(self, seconds={**self.seconds, stage: seconds})


def look_at_file(
    number: int,
    name: str,
    path: Path,
    detector: Detector,
    camera: CameraChoice,
    *,
    network: PhotoNetwork | None = None,
) -> LookedAt:
    """Read a photograph and find its hands; what is wrong with it is logged and returned, not raised.

    Args:
        number: Index among all photographs of the command.
        name: Name by which results refer to it.
        path: The file.
        detector: Finds the hands.
        camera: How its camera is determined.
        network: Looks at the hands, and finds landmarks where the detector has none.
    """
    start = time.perf_counter()
    try:
        photo = read_photo(path)
    except (PhotoError, OSError, MemoryError) as error:
        reason = str(error) or type(error).__name__
        logger.error("%s", reason if str(path) in reason else f"{path}: {reason}")
        return LookedAt(number, name, path, error=reason)
    for note in photo.notes:
        logger.info("%s: %s", name, note)
    found = look_at(number, name, photo, detector, camera, network=network)
    read = time.perf_counter() - start - found.seconds.get("detect", 0.0)
    return replace(found, seconds={"read": read, **found.seconds})


def look_at(
    number: int,
    name: str,
    photo: Photo,
    detector: Detector,
    camera: CameraChoice,
    *,
    network: PhotoNetwork | None = None,
) -> LookedAt:
    """Find the hands of a photograph; arguments as for `look_at_file`."""
    start = time.perf_counter()
    try:
        found = detector(photo.pixels, photo.path)
    except ValueError as error:
        # Such as a name in a file of boxes that could be either of two images.
        logger.error("%s: %s", name, error)
        return LookedAt(number, name, photo.path, photo.size, error=str(error))
    seconds = {"detect": time.perf_counter() - start}
    for sentence in found.dropped:
        logger.log(logging.INFO if found.hands else logging.WARNING, "%s: %s", name, sentence)
    seen = LookedAt(number, name, photo.path, photo.size, found.hands, seconds=seconds)
    try:
        if network is None or not seen.hands:
            return _with_camera(seen, photo, camera)
        found_by = _seen_by(network, seen, photo, camera)
    except ValueError as error:
        reason = f"{error} {photo.focal_note or ''}".strip()
        logger.error("%s: %s", name, reason)
        return replace(seen, hands=(), error=reason)
    # Finding a hand is what the detector and the network do together.
    return found_by.with_time("detect", time.perf_counter() - start)


def _seen_by(network: PhotoNetwork, seen: LookedAt, photo: Photo, camera: CameraChoice) -> LookedAt:
    """Give a photograph its camera and its hands a network's estimate.

    Raises:
        ValueError: As of `_with_camera`, or the network's numbers are not finite.
    """
    hands, found = network.find(photo.pixels, seen.hands)
    placed = _with_camera(replace(seen, hands=hands), photo, camera)
    if placed.camera is None:
        raise AssertionError
    # Crops and landmarks in them are those of the photograph as it is, with its lens distortion.
    hands, estimate = network.place(photo.pixels, hands, found, placed.camera)
    if camera.cameras is None or not found:
        hands = tuple(
            after if place in found else before
            for place, (before, after) in enumerate(zip(placed.hands, hands, strict=True))
        )
        return replace(placed, hands=hands, estimate=estimate)
    return replace(_with_camera(replace(seen, hands=hands), photo, camera), estimate=estimate)


def _with_camera(seen: LookedAt, photo: Photo, camera: CameraChoice) -> LookedAt:
    """Give a photograph its camera; a camera file's lens distortion is removed from the landmarks.

    Raises:
        ValueError: EXIF is asked for and has no focal length, or the camera is of another image.
    """
    if camera.cameras is None:
        sides = [np.ptp(hand.landmarks_2d, axis=0).max() for hand in seen.hands]
        chosen = camera.of_photo(photo.size, photo.focal_px, np.array(sides, dtype=float))
        return replace(seen, camera=chosen.matrix, camera_source=chosen.source)
    return with_given(seen, camera)


def with_given(seen: LookedAt, camera: CameraChoice) -> LookedAt:
    """Give an image its camera of a file of cameras, whose lens distortion is removed from the landmarks.

    Args:
        seen: The image, whose number is that of its camera if the file has several.
        camera: The file's cameras.

    Raises:
        ValueError: The camera is of another image.
    """
    if not seen.hands:
        return seen
    landmarks, _ = to_landmarks([replace(seen, camera=np.eye(3))], Origin())
    given = with_given_camera(landmarks, camera, seen.number)
    if given.intrinsics is None:
        raise AssertionError
    hands = tuple(
        replace(hand, landmarks_2d=points)
        for hand, points in zip(seen.hands, given.landmarks_2d.numpy(), strict=True)
    )
    return replace(seen, hands=hands, camera=given.intrinsics[0].numpy(), camera_source="given")


def photo_of_array(pixels: UInt8[np.ndarray, "height width 3"]) -> Photo:
    """An RGB array as a photograph without a file."""
    return Photo(
        pixels=pixels,
        path=None,
        stored_size=(pixels.shape[1], pixels.shape[0]),
        orientation=1,
    )


def to_landmarks(
    looked: Sequence[LookedAt], origin: Origin
) -> tuple[ImageLandmarks, tuple[Origin, ...]]:
    """Landmarks of all hands of some photographs, and the origin of each hand.

    Args:
        looked: The photographs.
        origin: What all hands have in common.
    """
    pairs = [(one, hand) for one in looked for hand in one.hands]
    points = np.array([hand.landmarks_2d for _, hand in pairs], dtype=np.float64)
    tensor = torch.from_numpy(points.reshape(-1, 21, 2))
    cameras = np.array([one.camera for one, _ in pairs], dtype=np.float64).reshape(-1, 3, 3)
    landmarks = ImageLandmarks(
        landmarks_2d=tensor,
        labelled=tensor.isfinite().all(dim=-1),
        left=torch.tensor([hand.side == "left" for _, hand in pairs], dtype=torch.bool),
        names=tuple(one.name for one, _ in pairs),
        intrinsics=torch.from_numpy(cameras),
        sigma=_column([hand.sigma for _, hand in pairs]),
        confidence=_column([hand.confidence for _, hand in pairs]),
        images=tuple(one.path for one, _ in pairs),
        image_sizes=torch.tensor([one.size for one, _ in pairs], dtype=torch.float64).reshape(
            -1, 2
        ),
        estimate=_joined([one.estimate for one in looked if one.hands]),
    )
    origins = tuple(
        replace(
            origin, image=one.name, image_size=one.size, score=hand.score, camera=one.camera_source
        )
        for one, hand in pairs
    )
    return landmarks, origins


def _joined(estimates: Sequence[HandEstimate | None]) -> HandEstimate | None:
    """Estimates of all hands; None without a network."""
    known = [one for one in estimates if one is not None]
    return HandEstimate.join(known) if known and len(known) == len(estimates) else None


def _column(
    values: Sequence[Float[np.ndarray, "landmark=21"] | None],
) -> Float[torch.Tensor, "hand landmark=21"] | None:
    """One row per hand, NaN where a hand has none; None if no hand has one."""
    if all(row is None for row in values):
        return None
    unknown = np.full(21, np.nan)
    return torch.from_numpy(
        np.array([unknown if row is None else row for row in values], dtype=float)
    )


def build_detector(config: DictConfig) -> Detector:
    """Build the detector of a configuration, and say which landmarks it needs if it lacks them.

    Beside a network, boxes and whole images are looked at by that network alone.

    Raises:
        ValueError: `detector=landmarks` without a file, or a hand whose side nobody gives.
    """
    if gives_boxes_alone(config):
        return _boxes_alone(config)
    if config.detector.get("_target_") is not None:
        detector: Detector = instantiate(config.detector)
        return detector
    return FileLandmarks.from_config(config.detector)


def _boxes_alone(config: DictConfig) -> Detector:
    """Detector of boxes without landmarks."""
    if "boxes" not in config.detector:
        return WholeImages(config.side)
    return GivenBoxes(config.detector.boxes, config.detector.min_side, config.side)


def steps_before(detector: Detector, network: PhotoNetwork | None) -> str:
    """Steps before a fit, in the words of `Origin.source`.

    Args:
        detector: Found the hands.
        network: Looked at them; None for none.
    """
    return detector.name if network is None else f"{detector.name}, {network.name}"


def photo_names(files: Sequence[Path]) -> list[str]:
    """Names of files in results: file names, or as much of the paths as makes them different."""
    names = [path.name for path in files]
    if len(set(names)) == len(names):
        return names
    absolute = [path.absolute() for path in files]
    shared = Path(*_common([path.parent for path in absolute]))
    return [path.relative_to(shared).as_posix() for path in absolute]


def _common(folders: Sequence[Path]) -> list[str]:
    levels = zip(*(folder.parts for folder in folders), strict=False)
    return [level[0] for level in itertools.takewhile(lambda level: len(set(level)) == 1, levels)]
