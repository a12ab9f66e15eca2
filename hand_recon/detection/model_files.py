"""The two models in files that a user names: the models themselves, or zip files that hold them.

Models are recognised by size and digest, never by name, and nothing is unpacked to the disk.
"""

import io
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from hand_recon.detection.models import (
    BUNDLE_FILE,
    MODELS,
    Model,
    ModelsError,
    is_official_bundle,
)

LARGEST: Final = 200_000_000
"""Largest file that is looked into, bytes; the largest that is known to hold the models has 36 MB."""

WANTED: Final = (
    "MediaPipe's hand_landmarker.task, the wheel of mediapipe 0.10.21, or palm_detection_full.tflite and "
    "hand_landmark_full.tflite of that version"
)


def models_in(paths: Iterable[Path]) -> dict[str, bytes]:
    """The models in some files, by the name that they have in the cache.

    Args:
        paths: Files, or folders of them.

    Raises:
        ModelsError: A file is missing, damaged or too large.
    """
    found: dict[str, bytes] = {}
    for path in paths:
        files = sorted(path.rglob("*.tflite")) if path.is_dir() else [path]
        for file in files:
            found |= models_in_content(_content(file), str(file))
    return found


def models_in_content(content: bytes, name: str) -> dict[str, bytes]:
    """The models in the content of a file, by the name that they have in the cache.

    MediaPipe's own bundle is returned as it is, should its models differ from those of the wheel.

    Args:
        content: The file's bytes.
        name: The file's name, for error messages.

    Raises:
        ModelsError: It is a damaged zip file.
    """
    # A model is a zip file, too: it ends with its labels.
    for model in MODELS:
        if model.matches(content):
            return {model.file: content}
    if not zipfile.is_zipfile(io.BytesIO(content)):
        return {}
    try:
        found = _members(content)
    except (zipfile.BadZipFile, RuntimeError, NotImplementedError, EOFError, OSError) as error:
        raise ModelsError(f"{name} is a damaged zip file ({error}). Download it again.") from error
    if len(found) < len(MODELS) and is_official_bundle(content):
        return {BUNDLE_FILE: content}
    return found


def names_of(models: Iterable[Model]) -> str:
    """The files of some models, for messages."""
    return " and ".join(model.file for model in models)


def _members(content: bytes) -> dict[str, bytes]:
    found = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for info in archive.infolist():
            for model in MODELS:
                # Sizes are declared by the archive: no more than that is ever inflated.
                if info.file_size == model.size:
                    with archive.open(info) as member:
                        inside = member.read(model.size + 1)
                    if model.matches(inside):
                        found[model.file] = inside
    return found


def _content(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise ModelsError(
                f"{path} has {size} bytes, more than {LARGEST}: it cannot be {WANTED}."
            )
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ModelsError(f"No file {path}. Name {WANTED}.") from error
