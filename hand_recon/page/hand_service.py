"""Work of the page's server: files to hands, frames of a clip, downloads, and images of a webcam.

It runs in a process of its own (`hand_recon.page.worker`), since a file can take too long or end a process.
"""

import base64
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from jaxtyping import UInt8
from omegaconf import DictConfig

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.photos.photo import read_photo
from hand_recon.fitting.hands_file import read_hands
from hand_recon.fitting.origin import Origin
from hand_recon.fitting.photo_camera import parse_camera
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.page.bounds import Bounds
from hand_recon.page.downloads import Download, download, offered
from hand_recon.page.hand_views import hands_view, model_view, rows_view
from hand_recon.page.kept_results import ForgottenError, KeptResult, KeptResults
from hand_recon.page.knowledge_rows import ROWS
from hand_recon.page.live_view import LiveView, decoded_image
from hand_recon.page.posed_files import played_frames, posed, selected
from hand_recon.page.row_fits import GivenHands, RowFits
from hand_recon.page.uploads import saved, upload_kind
from hand_recon.runs.configuration import configure_process
from hand_recon.runs.fit_run import file_origins
from hand_recon.runs.looking import build_detector, look_at, to_landmarks

PREVIEW_SIDE: Final = 1600
"""Longer side of the photograph that the page shows, pixels."""

MOST_FRAMES: Final = 60
"""Frames of a clip in one answer."""


class HandService:
    """Everything that the page asks for, with networks and fits kept ready.

    Args:
        config: `conf/demo.yaml` composed.
    """

    def __init__(self, config: DictConfig) -> None:
        configure_process(config.threads)
        logging.getLogger("hand_recon").setLevel(logging.INFO)
        self.config, self.bounds = config, Bounds.from_config(config.bounds)
        self.fits = RowFits(config, ROWS)
        self.hand = self.fits.hand
        self.ranges = load_ranges("literature", self.hand.rest_angles)
        self.detector = build_detector(self.fits.configs[ROWS[-1].key])
        self.camera = parse_camera(str(config.camera), 1)
        self.kept = KeptResults()
        self.view: LiveView | None = None

    def about(self) -> dict[str, Any]:
        """The hand model, the formats and the file of hands that the command was given."""
        return {
            "model": model_view(self.hand),
            "formats": offered(self.hand),
        }

    def file(self, name: str, content: bytes) -> dict[str, Any]:
        """Make hands of a file: a photograph, 2D landmarks or a file of hands.

        Args:
            name: The file's name.
            content: Its bytes.

        Raises:
            ValueError: It cannot be read.
        """
        kind = upload_kind(name, content)
        with saved(name, content) as path, _collected_notes() as notes:
            if kind == "hands":
                found = self.hands_file(path)
            else:
                found = self._photo(path) if kind == "photo" else self._landmarks(path)
        # Without the folder, which the browser does not know.
        said = [note.replace(f"{path.parent}{os.sep}", "") for note in notes]
        return found | {"notes": list(dict.fromkeys(said))}

    def _photo(self, path: Path) -> dict[str, Any]:
        photo = read_photo(path, self.bounds.pixels)
        looked = look_at(0, path.name, photo, self.detector, self.camera)
        if looked.error is not None:
            raise ValueError(looked.error)
        landmarks, origins = to_landmarks([looked], Origin())
        found = self._fitted(path.name, landmarks, origins, self.detector.name)
        width, height = photo.size
        image = {"width": width, "height": height, "url": _preview(photo.pixels)}
        return found | {"kind": "photo", "image": image}

    def _landmarks(self, path: Path) -> dict[str, Any]:
        landmarks = read_landmarks(path)
        origins = file_origins(landmarks, Origin())
        found = self._fitted(path.name, landmarks, origins, "landmarks")
        return found | {"kind": "landmarks", "image": None}

    def _fitted(
        self, name: str, landmarks: ImageLandmarks, origins: tuple[Origin, ...], before: str
    ) -> dict[str, Any]:
        most = self.bounds.hands
        if len(landmarks) > most:
            logging.getLogger(__name__).warning(
                "%d hands are in the file, and the page fits the first %d; hand-recon fit fits all.",
                len(landmarks), most,
            )  # fmt: skip
        given = GivenHands(landmarks.select(slice(most)), origins[:most], before)
        best = ROWS[-1].key
        rows = {best: self.fits(given, best)} if len(landmarks) else {}
        number = self.kept.add(KeptResult(name, rows, given if rows else None))
        return {"id": number, "name": name, "rows": rows_view(rows, self.ranges)}

    def rows(self, number: int) -> dict[str, Any]:
        """Fit the hands of a result with the knowledge of every row.

        Args:
            number: The result.

        Raises:
            ForgottenError: The result is not kept any more, or has no landmarks to fit to.
        """
        kept = self.kept[number]
        if kept.given is None:
            raise ForgottenError(f"Result {number} has no landmarks to fit to. Give another file.")
        for row in ROWS:
            if row.key not in kept.rows:
                kept.rows[row.key] = self.fits(kept.given, row.key)
        return rows_view({row.key: kept.rows[row.key] for row in ROWS}, self.ranges)

    def hands_file(self, path: str | Path) -> dict[str, Any]:
        """Open a file of hands, to be played frame by frame.

        Args:
            path: The file.

        Raises:
            ValueError: It is no such file, or of another hand model.
        """
        path = Path(path)
        records = read_hands(path)
        frames = tuple(played_frames(records))
        if not frames:
            raise ValueError(
                f"{path.name} holds no hand; expected one or more. Give another file of hands."
            )
        number = self.kept.add(KeptResult(path.name, {}, played=records, frames=frames))
        of_clip = records.moments[0] is not None
        return {
            "kind": "clip" if of_clip else "hands",
            "id": number,
            "name": path.name,
            "frames": [{"label": one.label, "time": one.time} for one in frames],
            "first": self.frames(number, 0, MOST_FRAMES),
        }

    def frames(self, number: int, first: int, count: int) -> list[list[dict[str, Any]]]:
        """Hands of some frames of a file of hands.

        Args:
            number: The result.
            first: Index of the first frame.
            count: Number of frames, at most `MOST_FRAMES`.

        Raises:
            ForgottenError: The result is not kept any more.
            ValueError: The hands are of another hand model.
        """
        kept = self.kept[number]
        records = kept.played
        if records is None:
            raise ForgottenError(f"Result {number} has no frames. Give the file again.")
        chosen = kept.frames[first : first + min(count, MOST_FRAMES)]
        return [
            hands_view(posed(selected(records, one.rows), self.hand), self.ranges) for one in chosen
        ]

    def download(self, number: int, row: str, name: str) -> Download:
        """Hands of a result in a format.

        Args:
            number: The result.
            row: Key of the row; `file` for a file of hands.
            name: The format.

        Raises:
            ForgottenError: The result is not kept any more.
            ValueError: The format is unknown, or cannot hold these hands.
        """
        kept = self.kept[number]
        records = kept.records(row)
        if records is None:
            raise ForgottenError(f"Result {number} has no row {row!r}. Give the file again.")
        return download(name, records, self.hand, kept.name)

    def live(self, content: bytes, *, is_first: bool) -> dict[str, Any]:
        """Hands of the next image of the webcam.

        Args:
            content: A JPEG image, not mirrored.
            is_first: True for the first image after the camera was started.

        Raises:
            ValueError: It is no JPEG image, has too many pixels, or the detector is for files.
        """
        if self.view is None or is_first:
            config = self.fits.configs[ROWS[-1].key]
            self.view = LiveView(config, self.hand, self.detector, self.ranges)
        return self.view(decoded_image(content, self.bounds))


def _preview(pixels: UInt8[np.ndarray, "height width 3"]) -> str:
    """The photograph as the address of a JPEG image, small enough for a page."""
    factor = min(1.0, PREVIEW_SIDE / max(pixels.shape[:2]))
    if factor < 1:
        height, width = (max(1, round(factor * side)) for side in pixels.shape[:2])
        pixels = np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA))
    _, encoded = cv2.imencode(".jpg", pixels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    return f"data:image/jpeg;base64,{base64.b64encode(encoded.tobytes()).decode('ascii')}"


class _Notes(logging.Handler):
    """Collects messages."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.sentences: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a message."""
        self.sentences.append(record.getMessage())


@contextmanager
def _collected_notes() -> Iterator[list[str]]:
    """Collect what the package logs, which a command would print."""
    logger, notes = logging.getLogger("hand_recon"), _Notes()
    logger.addHandler(notes)
    try:
        yield notes.sentences
    finally:
        logger.removeHandler(notes)
