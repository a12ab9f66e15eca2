"""Hands of the images of a column: what `hand-recon predict` does, with errors as values."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from omegaconf import OmegaConf

from hand_recon.fitting.in_parts import PART, fit_part
from hand_recon.fitting.photo_camera import CameraChoice, given_cameras, parse_camera
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.runs.configuration import build_hand, configure_process
from hand_recon.runs.fit_landmarks import check_cameras
from hand_recon.runs.fit_run import source_of
from hand_recon.runs.fitters import build_fitter
from hand_recon.runs.looking import LookedAt, build_detector, look_at, steps_before, to_landmarks
from hand_recon.runs.photo_checkpoint import with_network
from hand_recon.scale.isolation import NOT_OF_A_ROW, reason_of, rows_or_errors
from hand_recon.scale.readers import ImageReader
from hand_recon.scale.schema import failed_image, hand_structs

BLANK: Final = np.zeros((64, 64, 3), dtype=np.uint8)
"""Image without hands, on which a worker tries its detector once."""


@dataclass(frozen=True)
class ImageTask:
    """One image of a column."""

    value: object
    """The image, as `ImageReader` takes it."""
    intrinsics: object = None
    """Camera matrix, 3 × 3, pixels; None for the camera of the settings."""


class ImageWorker:
    """Detector, fit and reader of one process."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        """Load the networks, and try the detector once.

        Args:
            settings: `conf/predict.yaml` composed, as `worker_settings` gives it.

        Raises:
            ModuleNotFoundError: A package of the detector is not installed.
            ModelsError: The detector's models cannot be had.
            ValueError: A setting is out of its range.
        """
        configure_process(1)
        config, self.network = with_network(OmegaConf.create(dict(settings)))
        self.camera = parse_camera(str(config.camera), 1)
        self.detector = build_detector(config)
        if self.detector.name == "mediapipe":
            self.detector(BLANK)
        hand = build_hand(config)
        self.fitter = build_fitter(config, hand)
        self.origin = source_of(config, hand, steps_before(self.detector, self.network))
        self.read = ImageReader()

    def __call__(self, tasks: Sequence[ImageTask]) -> list[dict[str, Any]]:
        """Reconstruct the hands of images.

        Args:
            tasks: The images.

        Returns:
            One row per image, as `schema.image_type` describes it, in order.
        """
        looked = [self._looked_at(number, task) for number, task in enumerate(tasks)]
        return [
            row
            for batch in _batches(looked)
            for row in rows_or_errors(batch, self._fitted, _failed)
        ]

    def _looked_at(self, number: int, task: ImageTask) -> LookedAt:
        name = str(number)
        try:
            photo = self.read(task.value)
            camera = self._camera(task.intrinsics)
            # A worker has one camera, whose number is 0.
            return look_at(0, name, photo, self.detector, camera, network=self.network)
        except NOT_OF_A_ROW:
            raise
        except Exception as error:  # noqa: BLE001  # decoders and networks can raise anything
            return LookedAt(number, name, error=reason_of(error))

    def _camera(self, intrinsics: object) -> CameraChoice:
        if intrinsics is None:
            return self.camera
        matrix = np.asarray(intrinsics, dtype=np.float64)
        if matrix.size != 9:
            raise ValueError(f"intrinsics has the shape {matrix.shape}; expected (3, 3).")
        matrix = matrix.reshape(3, 3)
        check_cameras("intrinsics", matrix)
        return given_cameras(matrix[None])

    def _fitted(self, batch: Sequence[LookedAt]) -> list[dict[str, Any]]:
        """Fit the hands of some images, which are one batch."""
        hands: list[dict[str, Any]] = []
        if any(one.hands for one in batch):
            landmarks, origins = to_landmarks(batch, self.origin)
            hands = hand_structs(to_records(fit_part(landmarks, self.fitter, origins)))
        rows, found = [], iter(hands)
        for one in batch:
            own = [next(found) for _ in one.hands]
            rows.append(_failed(one, one.error) if one.error else _row(one, own))
        return rows


def _batches(looked: Sequence[LookedAt]) -> Iterator[list[LookedAt]]:
    """Group images so that a batch has about `PART` hands."""
    batch: list[LookedAt] = []
    for one in looked:
        batch.append(one)
        if sum(len(each.hands) for each in batch) >= PART:
            yield batch
            batch = []
    if batch:
        yield batch


def _row(one: LookedAt, hands: list[dict[str, Any]]) -> dict[str, Any]:
    width, height = one.size or (None, None)
    return {"hands": hands, "width": width, "height": height, "error": None}


def _failed(one: LookedAt, error: str) -> dict[str, Any]:
    return failed_image(error, one.size)
