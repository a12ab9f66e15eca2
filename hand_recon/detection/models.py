"""MediaPipe's two models in a cache folder, pinned by their digests."""

import hashlib
import io
import logging
import os
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

logger = logging.getLogger(__name__)


class ModelsError(OSError):
    """The models cannot be had; the text says how to get them."""


@dataclass(frozen=True)
class Model:
    """One of the two networks, as published in MediaPipe 0.10.21 (Apache License 2.0)."""

    file: str
    """Name of the file in the cache."""
    size: int
    """Size, bytes."""
    sha256: str
    """Digest of the file, 64 hex digits."""
    bundled_as: str
    """Name of the file in the bundle `hand_landmarker.task`."""

    def matches(self, content: bytes) -> bool:
        """True if a content is this model, to the bit."""
        return len(content) == self.size and hashlib.sha256(content).hexdigest() == self.sha256


PALMS: Final = Model(
    "palm_detection_full.tflite",
    2_339_846,
    "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54",
    "hand_detector.tflite",
)
"""The palm network."""

LANDMARKS: Final = Model(
    "hand_landmark_full.tflite",
    5_478_917,
    "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3",
    "hand_landmarks_detector.tflite",
)
"""The landmark network."""

MODELS: Final = (PALMS, LANDMARKS)


def cache_folder() -> Path:
    """The folder of the models: `detector` in $HAND_RECON_CACHE, or in the user's own cache folder."""
    if own := os.environ.get("HAND_RECON_CACHE"):
        return Path(own).expanduser() / "detector"
    user = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(user).expanduser() / "hand_recon" / "detector"


BUNDLE_FILE: Final = "hand_landmarker.task"

BUNDLE_SIZE: Final = 7_819_105

BUNDLE_SHA256: Final = "fbc2a30080c3c557093b5ddfc334698132eb341044ccee322ccf8bcf3607cde1"
"""Digest of MediaPipe's own bundle of the two networks, a zip file, version float16/1."""


def is_official_bundle(content: bytes) -> bool:
    """True if a content is MediaPipe's own bundle, to the bit."""
    return len(content) == BUNDLE_SIZE and hashlib.sha256(content).hexdigest() == BUNDLE_SHA256


class ModelFolder:
    """A folder that holds the two models, or MediaPipe's bundle of both."""

    def __init__(self, path: str | Path | None = None) -> None:
        """Store the folder, which need not exist.

        Args:
            path: The folder; none for the cache's.
        """
        self.path = cache_folder() if path is None else Path(path).expanduser()

    def read(self, model: Model) -> bytes | None:
        """The content of a model; none, with a warning, if its file is damaged, and none if it is missing."""
        content = self._content(model.file)
        if content is None:
            return self._from_bundle(model)
        if model.matches(content):
            return content
        self._complain(model.file)
        return None

    def missing(self) -> list[Model]:
        """The models that are not here, or damaged."""
        return [model for model in MODELS if self.read(model) is None]

    def make(self) -> None:
        """Make the folder.

        Raises:
            ModelsError: It cannot be made.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ModelsError(
                f"The folder {self.path} for the detector's models cannot be made ({error.strerror}). Name "
                "another in the environment's HAND_RECON_CACHE, or with detector.models=<folder>."
            ) from error

    def write(self, name: str, content: bytes) -> Path:
        """Write a file at once: other processes see the old one or the whole new one.

        Raises:
            OSError: The folder cannot be written to.
        """
        self.make()
        descriptor, partial = tempfile.mkstemp(dir=self.path, prefix=f".{name}.")
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
            Path(partial).chmod(0o644)
            Path(partial).replace(self.path / name)
        except BaseException:
            Path(partial).unlink(missing_ok=True)
            raise
        return self.path / name

    def _content(self, name: str) -> bytes | None:
        try:
            return (self.path / name).read_bytes()
        except OSError:
            return None

    def _from_bundle(self, model: Model) -> bytes | None:
        content = self._content(BUNDLE_FILE)
        if content is None:
            return None
        if not is_official_bundle(content):
            self._complain(BUNDLE_FILE)
            return None
        with zipfile.ZipFile(io.BytesIO(content)) as bundle:
            return bundle.read(model.bundled_as)

    def _complain(self, name: str) -> None:
        logger.warning(
            "%s is not the published file: it is damaged, or another. It is replaced.",
            self.path / name,
        )
