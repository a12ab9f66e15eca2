"""Finds and reconstructs the hands of photographs: what `hand-recon predict` does, as a function."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from PIL import Image, ImageOps

from hand_recon.command_line.composing import composed
from hand_recon.data.photos.photo import Photo, read_photo
from hand_recon.fitting.in_parts import fit_in_parts
from hand_recon.fitting.photo_camera import CameraChoice, given_cameras, parse_camera
from hand_recon.runs.configuration import build_hand
from hand_recon.runs.fit_landmarks import check_cameras, check_overrides
from hand_recon.runs.fit_run import adapted_to_data, source_of
from hand_recon.runs.fitters import fitter_of
from hand_recon.runs.looking import (
    LookedAt,
    build_detector,
    look_at,
    photo_names,
    photo_of_array,
    steps_before,
    to_landmarks,
)
from hand_recon.runs.photo_checkpoint import gives_boxes_alone, with_network
from hand_recon.runs.reconstructed_hands import ReconstructedHands, image_inputs

COMMAND_ONLY: Final = frozenset(
    {"batch", "camera", "ckpt", "column", "engine", "input", "json", "name", "output", "part", "ray",
     "results", "strict", "threads", "workers"}
)  # fmt: skip
"""Settings of `hand-recon predict` that `reconstruct` does not read."""


def reconstruct(
    images: Any,  # noqa: ANN401  # a file, an array, or several
    *,
    camera: Any = "auto",  # noqa: ANN401
    ckpt: str | Path | None = None,
    overrides: Sequence[str] = (),
) -> ReconstructedHands:
    """Find the hands of photographs and reconstruct them with knowledge of hands (Sec. 3.2-3.4).

    Args:
        images: A file, an RGB array (height × width × 3, bytes), an image of Pillow, or a list of these.
        camera: `auto` (EXIF's focal length, else assumed), `exif`, `assumed`, `fov=<degrees>`, a file of
            camera matrices, or a matrix: 3 × 3, or one per image.
        ckpt: Run's folder or checkpoint of a network that looks at the hands (`hand-recon train
            recipe=photos`); none for landmarks alone.
        overrides: Settings of `hand-recon predict`, such as `detector=whole` or `detector.max_hands=1`.

    Raises:
        FileNotFoundError: There is no such checkpoint.
        ValueError: An image cannot be read, or an argument is not as above.
    """
    check_overrides(overrides, COMMAND_ONLY, "reconstruct")
    given = image_inputs(images)
    photos = [_photo(one) for one in given]
    names = _names(given)
    choice = _camera(camera, len(photos))
    with torch.inference_mode(False), torch.enable_grad():
        config = adapted_to_data(composed("predict", ["input=[]", *overrides]))
        config.ckpt = None if ckpt is None else str(ckpt)
        config, network = with_network(config)
        hand = build_hand(config)
        with_file = {"boxes", "landmarks"} & set(config.detector)
        # One with a file of its own is read anew: the file may have changed.
        own = with_file or gives_boxes_alone(config)
        detector = build_detector(config) if own else _detector(tuple(overrides))
        looked = [
            look_at(number, name, photo, detector, choice, network=network)
            for number, (name, photo) in enumerate(zip(names, photos, strict=True))
        ]
        _refuse_errors(looked)
        origin = source_of(config, hand, steps_before(detector, network))
        landmarks, origins = to_landmarks(looked, origin)
        parts = tuple(fit_in_parts(landmarks, fitter_of(config, hand, landmarks), origins=origins))
    owners = tuple(one.number for one in looked for _ in one.hands)
    return ReconstructedHands(
        parts, hand.faces.numpy(), tuple(photo.pixels for photo in photos), owners
    )


@lru_cache(maxsize=4)
def _detector(overrides: tuple[str, ...]) -> Any:  # noqa: ANN401  # a `Detector`
    """The detector of some settings, kept for the next call, because its networks take time to load."""
    return build_detector(composed("predict", ["input=[]", *overrides]))


def _photo(image: Any) -> Photo:  # noqa: ANN401
    if isinstance(image, str | Path):
        return read_photo(image)
    pixels = np.asarray(ImageOps.exif_transpose(image) if isinstance(image, Image.Image) else image)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8 or not pixels.size:
        raise ValueError(
            f"An image has the shape {pixels.shape} and the type {pixels.dtype}; expected height × width × 3 "
            "in bytes (uint8), RGB, or a file name."
        )
    return photo_of_array(pixels)


def _names(given: Sequence[Any]) -> list[str]:
    files = [one for one in given if isinstance(one, str | Path)]
    named = iter(photo_names([Path(file) for file in files]))
    return [
        next(named) if isinstance(one, str | Path) else f"image {number}"
        for number, one in enumerate(given)
    ]


def _camera(camera: Any, photos: int) -> CameraChoice:  # noqa: ANN401
    if isinstance(camera, str | Path):
        return parse_camera(str(camera), photos)
    matrices = np.asarray(camera, dtype=np.float64)
    if matrices.shape not in ((3, 3), (photos, 3, 3)):
        raise ValueError(
            f"camera has the shape {matrices.shape}; expected (3, 3) or ({photos}, 3, 3)."
        )
    check_cameras("camera", matrices)
    return given_cameras(matrices.reshape(-1, 3, 3))


def _refuse_errors(looked: Sequence[LookedAt]) -> None:
    for one in looked:
        if one.error is not None:
            raise ValueError(f"{one.name}: {one.error}")
