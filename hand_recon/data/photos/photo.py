"""Photographs as people have them, upright and in sRGB, with what EXIF says about the camera.

Pillow reads them all (decision 60): it gives the orientation and the metadata of every format, where OpenCV
rotates some formats only, gives no metadata and reads no HEIC. Training reads its many images with
`hand_recon.data.images.read_image`, which is faster.
"""

import importlib
import io
import stat
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import UInt8
from PIL import Image, features

from hand_recon.data.photos.colours import to_srgb
from hand_recon.data.photos.exif import focal, orientation, to_upright
from hand_recon.data.photos.formats import HEADER, Kind, PhotoError, kind_of, kind_of_file, shown
from hand_recon.reading.limits import LIMITS

LARGEST_PHOTO: Final = LIMITS.photo_pixels
"""Most pixels of a photograph."""

_SEVERAL: Final = {"GIF": "frames", "PNG": "frames", "WEBP": "frames", "AVIF": "frames"}
_ROTATED_BY_THEIR_READERS: Final = ("TIFF", "HEIF")
_limit = threading.Lock()


@dataclass(frozen=True)
class Photo:
    """A photograph, upright."""

    pixels: UInt8[np.ndarray, "height width 3"]
    """sRGB."""
    path: Path | None
    """File; None for an array."""
    stored_size: tuple[int, int]
    """Width and height before the rotation that EXIF asks for, pixels."""
    orientation: int
    """EXIF's orientation, 1 (stored upright) to 8; it is applied to the pixels."""
    focal_35mm: float | None = None
    """Focal length on 35 mm film by EXIF, millimetres."""
    focal_px: float | None = None
    """Focal length by EXIF, pixels of this image.

    From FocalLength and FocalPlaneXResolution; without them, from FocalLengthIn35mmFilm by the image's
    diagonal, which is 43.27 mm on 35 mm film. A crop makes it wrong. It is None for crops that show: by their
    shape, or because EXIF contradicts itself; a crop of a camera's shape by a program that rewrites EXIF does
    not show.
    """
    focal_note: str | None = None
    """Reason why EXIF's focal length is not used; None if it is, or if there is none."""
    notes: tuple[str, ...] = ()
    """Sentences on what was left out or converted."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.pixels.shape[1], self.pixels.shape[0]


def read_photo(path: str | Path, largest: int | None = None) -> Photo:
    """Read a photograph of any common format; its content decides which, not the suffix of its name.

    JPEG, PNG, WebP, TIFF, AVIF, GIF, BMP, JPEG 2000, PPM and, with pi-heif, HEIC. Grey, palette, CMYK and
    16-bit images become 8-bit sRGB, transparent parts white, and EXIF's orientation is applied. Of files with
    several images the first is read, with a note.

    Files are read one after the other, also by several threads, because Pillow's limits are the process's.
    The peak of memory is 10 bytes a pixel, 18 for WebP: 1.1 GB for a JPEG of 12,000 × 9,000.

    Args:
        path: The file.
        largest: Most pixels, `LARGEST_PHOTO` or fewer; none for `LARGEST_PHOTO`. Photographs with more are
            refused before they are decoded.

    Raises:
        PhotoError: There is no such file, or it is no photograph, damaged, cut off, larger than `largest`,
            or HEIC without pi-heif.
    """
    path = Path(path)
    kind = _checked_kind(path)
    with _damage_named(path, kind), path.open("rb") as stream:
        return _read(stream, path, kind, largest)


def read_photo_bytes(content: bytes, name: str | Path, largest: int | None = None) -> Photo:
    """Read a photograph from the bytes of its file, as a table holds them; see `read_photo`.

    Args:
        content: The whole file.
        name: Its name, for messages and as the photograph's path; it need not exist.
        largest: As of `read_photo`.

    Raises:
        PhotoError: The bytes are no photograph, damaged, cut off, larger than `largest`, or HEIC without
            pi-heif.
    """
    path = Path(name)
    kind = _readable_kind(path, kind_of(content[:HEADER], path.suffix))
    with _damage_named(path, kind):
        return _read(io.BytesIO(content), path, kind, largest)


@contextmanager
def _damage_named(path: Path, kind: Kind) -> Iterator[None]:
    """Turn every error of a decoder into a `PhotoError` that names the file."""
    try:
        yield
    except PhotoError:
        raise
    except Exception as error:
        # A damaged file can raise anything in its decoder.
        raise _damaged(path, kind, error) from error


def _read(
    stream: io.BufferedReader | io.BytesIO, path: Path, kind: Kind, largest: int | None
) -> Photo:
    with _own_limit(), Image.open(stream, formats=[kind.name]) as image:
        _check_size(path, image.size, largest or LARGEST_PHOTO)
        return _decoded(image, path, kind)


def _checked_kind(path: Path) -> Kind:
    try:
        kind = _kind_of_ordinary_file(path)
    except FileNotFoundError:
        raise PhotoError(
            f"No file at {shown(path)}; expected a photograph. Check the name and the folder."
        ) from None
    except OSError as error:
        raise PhotoError(
            f"Cannot open {shown(path)}: {error.strerror}. Check its name and permissions."
        ) from error
    return _readable_kind(path, kind)


def _readable_kind(path: Path, kind: Kind) -> Kind:
    """The kind, if it is one that is read here."""
    if kind.refusal:
        raise PhotoError(f"{shown(path)} is no photograph that can be read. {kind.refusal}")
    if kind.name == "HEIF" and not _reads_heif():
        raise PhotoError(
            f"{shown(path)} is a HEIC image, for which a package is missing. Run pip install "
            '"hand-recon[heif]", or export the image as JPEG.'
        )
    if kind.name == "AVIF" and "avif" not in features.get_supported():
        raise PhotoError(
            f"{shown(path)} is an AVIF image, which this version of Pillow does not read. Update Pillow, or "
            "export the image as JPEG."
        )
    return kind


def _kind_of_ordinary_file(path: Path) -> Kind:
    if "\0" in str(path):
        raise PhotoError(
            f"{str(path)!r} is no file name, since it holds a zero byte. Check the name."
        )
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise PhotoError(f"{shown(path)} is a folder; expected a photograph. Name the files in it.")
    if not stat.S_ISREG(mode):
        # Opening a pipe would wait for its other end.
        raise PhotoError(
            f"{shown(path)} is no ordinary file; expected a photograph. Save it as a file first."
        )
    return kind_of_file(path)


def _reads_heif() -> bool:
    try:
        importlib.import_module("pi_heif").register_heif_opener()
    except ImportError:
        return False
    return True


@contextmanager
def _own_limit() -> Iterator[None]:
    """Replace Pillow's limit of pixels by `LARGEST_PHOTO`, and its warnings by silence, for one file."""
    with _limit, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        before, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, LARGEST_PHOTO
        try:
            yield
        finally:
            Image.MAX_IMAGE_PIXELS = before


def _check_size(path: Path, size: tuple[int, int], largest: int) -> None:
    if size[0] * size[1] > largest:
        raise PhotoError(
            f"{shown(path)} has {size[0]} × {size[1]} pixels; expected at most "
            f"{largest / 1e6:g} megapixels. Scale it down first."
        )


def _decoded(image: Image.Image, path: Path, kind: Kind) -> Photo:
    if kind.name == "PNG":
        # Its metadata may follow the pixels. TIFF's reader, in contrast, removes the orientation.
        image.load()
    rotation, facts = orientation(image), focal(image)
    notes = list(_notes(image, kind))
    image.load()
    try:
        converted, colour_notes = to_srgb(image)
    except ValueError as error:
        raise PhotoError(
            f"{shown(path)} cannot be converted: {error} Export it as an 8-bit JPEG or PNG."
        ) from error
    pixels = np.asarray(converted)
    if kind.name not in _ROTATED_BY_THEIR_READERS:
        pixels = to_upright(pixels, rotation)
    height, width, _ = pixels.shape
    return Photo(
        pixels=np.array(pixels, order="C"),
        path=path,
        stored_size=(height, width) if rotation >= 5 else (width, height),
        orientation=rotation,
        focal_35mm=facts.film,
        focal_px=facts.pixels,
        focal_note=facts.note or None,
        notes=(*notes, *colour_notes),
    )


def _notes(image: Image.Image, kind: Kind) -> Iterator[str]:
    count = getattr(image, "n_frames", 1)
    if count > 1 and image.format != "MPO":
        yield f"It holds {count} {_SEVERAL.get(kind.name, 'images')}; the first is read."


def _damaged(path: Path, kind: Kind, error: Exception) -> PhotoError:
    if isinstance(error, MemoryError):
        return PhotoError(
            f"There is not enough memory to read {shown(path)}, which takes 10 to 18 bytes a pixel. Scale it "
            "down first."
        )
    if isinstance(error, Image.DecompressionBombError):
        return PhotoError(
            f"{shown(path)} has more pixels than the {LARGEST_PHOTO / 1e6:.0f} million that are read. "
            "Scale it down first."
        )
    reason = "cut off" if "truncated" in str(error).lower() else "damaged"
    return PhotoError(f"{shown(path)} is a {reason} {kind.name} file. Copy or download it again.")
