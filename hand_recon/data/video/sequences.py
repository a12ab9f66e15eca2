"""Images that are the frames of a video: numbered files, folders, patterns, and animated images."""

import logging
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from hand_recon.data.photos.colours import to_srgb
from hand_recon.data.photos.formats import kind_of_file, shown
from hand_recon.data.photos.listing import photo_files
from hand_recon.data.photos.photo import read_photo
from hand_recon.data.video.frames import ASSUMED_RATE, Frame, FrameSource, VideoError

logger = logging.getLogger(__name__)

ANIMATED: Final = ("GIF", "PNG", "WEBP")
"""Formats of images that may hold several frames with durations."""

_NUMBER: Final = re.compile(r"%(?:0(\d+))?d")
_SHORTEST: Final = 0.02
"""Duration of a frame, seconds, below which browsers show it for `_DEFAULT`."""
_DEFAULT: Final = 0.1


class PhotoSequence(FrameSource):
    """Photographs of one size, as frames at a constant rate."""

    def __init__(
        self, files: Sequence[Path], name: str, rate: float, numbers: Sequence[int] | None = None
    ) -> None:
        """Read the first photograph.

        Args:
            files: Photographs in order, at least one.
            name: Name for messages.
            rate: Frames per second.
            numbers: Number of each in its series: where one is missing, the next is later by as much. None
                for photographs one after the other.

        Raises:
            PhotoError: The first photograph cannot be read.
        """
        self.name = name
        self.size: tuple[int, int] = read_photo(files[0]).size
        self.count_hint = len(files)
        self.rate_hint = rate
        self.files = tuple(files)
        self._times = [
            (number - numbers[0]) / rate for number in numbers
        ] if numbers else [k / rate for k in range(len(files))]  # fmt: skip

    def frames(self, first: int = 0) -> Iterator[Frame]:
        """Iterate over the photographs; see `FrameSource.frames`. Those before `first` are not read.

        Raises:
            PhotoError: A photograph cannot be read.
            VideoError: A photograph has another size than the first.
        """
        for number in range(first, len(self.files)):
            photo = read_photo(self.files[number])
            if photo.size != self.size:
                raise VideoError(
                    f"{shown(self.files[number])} has {_text(photo.size)} pixels, and "
                    f"{shown(self.files[0])} has {_text(self.size)}; the frames of a video have one size. "
                    "Take the odd one out, or give the images as photographs, without fps."
                )
            yield Frame(number, self._times[number], photo.pixels)


class Animation(FrameSource):
    """An animated GIF, PNG or WebP, with the durations of its frames."""

    def __init__(self, path: str | Path) -> None:
        """Read the head.

        Raises:
            VideoError: It is no animated image that can be read.
        """
        self._path = Path(path)
        self.name = shown(path)
        if not is_animation(self._path):
            raise VideoError(
                f"{self.name} is no animated GIF, PNG or WebP; expected several frames. Give it as a "
                "photograph."
            )
        try:
            with Image.open(self._path, formats=ANIMATED) as image:
                self.size = image.size
                self.count_hint = getattr(image, "n_frames", None)
        except Exception as error:
            # A damaged file can raise anything in its decoder.
            raise VideoError(
                f"{self.name} is damaged ({error}). Copy or download it again."
            ) from error

    def frames(self, first: int = 0) -> Iterator[Frame]:
        """Iterate over the frames; see `FrameSource.frames`."""
        time = 0.0
        with Image.open(self._path, formats=ANIMATED) as image:
            for number in range(self.count_hint or 0):
                try:
                    image.seek(number)
                    image.load()
                except (EOFError, OSError, SyntaxError, ValueError) as error:
                    logger.warning(
                        "%s ends after %d of %d frames (%s). Copy or download it again.",
                        self.name, number, self.count_hint, error,
                    )  # fmt: skip
                    return
                if number >= first:
                    yield Frame(number, time, np.array(to_srgb(image)[0]))
                duration = float(image.info.get("duration", 0)) / 1000
                time += duration if duration >= _SHORTEST else _DEFAULT


def is_animation(path: Path) -> bool:
    """True for a GIF, PNG or WebP, by its content, that holds more than one frame."""
    try:
        if kind_of_file(path).name not in ANIMATED:
            return False
        with Image.open(path, formats=ANIMATED) as image:
            return bool(getattr(image, "is_animated", False))
    except Exception:  # noqa: BLE001  # a damaged image raises anything; reading it as a photograph says what
        return False


def is_numbered(pattern: str) -> bool:
    """True for a name with one place for a number, such as `%05d.png`.

    >>> [is_numbered(name) for name in ("frames/%05d.png", "%d.jpg", "100%.jpg", "%d_%d.png")]
    [True, True, False, False]
    """
    return len(_NUMBER.findall(Path(pattern).name)) == 1


def numbered_sequence(pattern: str, rate: float | None = None) -> PhotoSequence:
    """Open the files whose names have a number in the place of `%05d` or `%d`, by increasing number.

    Args:
        pattern: Path whose last part holds `%d`, or `%05d` for numbers of at least five digits.
        rate: Frames per second; None for 30, with a note.

    Raises:
        VideoError: No file has such a name.
        PhotoError: The first photograph cannot be read.
    """
    folder, place = Path(pattern).parent, Path(pattern).name
    before, width, after = _NUMBER.split(place)
    digits = rf"(\d{{{int(width or 1)},}})"
    matching = re.compile(re.escape(before) + digits + re.escape(after))
    files = sorted(
        (int(match[1]), path)
        for path in (folder.iterdir() if folder.is_dir() else ())
        if (match := matching.fullmatch(path.name)) and _padded(match[1], width)
    )
    if not files:
        raise VideoError(
            f"No file in {shown(folder)} is called like {shown(place)}, with a number in place of "
            f"{_NUMBER.search(place)[0]}. Check the folder, the name and the number of digits."  # type: ignore[index]
        )
    numbers = [number for number, _ in files]
    if missing := numbers[-1] - numbers[0] + 1 - len(numbers):
        logger.warning(
            "%s lacks %d of the numbers from %d to %d; the others keep their times.",
            shown(pattern), missing, numbers[0], numbers[-1],
        )  # fmt: skip
    return PhotoSequence([path for _, path in files], shown(pattern), _rate(pattern, rate), numbers)


def photo_sequence(pattern: str | Path, rate: float | None = None) -> PhotoSequence:
    """Open the photographs of a folder or pattern as frames, in natural order.

    Args:
        pattern: Folder, or pattern such as `frames/*.png`.
        rate: Frames per second; None for 30, with a note.

    Raises:
        PhotoError: There is no photograph, or the first cannot be read.
    """
    files = photo_files([pattern])
    return PhotoSequence(files, shown(pattern), _rate(pattern, rate))


def _text(size: tuple[int, int]) -> str:
    return f"{size[0]} × {size[1]}"


def _padded(digits: str, width: str | None) -> bool:
    """True for digits as printf writes them: zeros in front up to the width alone."""
    return digits == f"{int(digits):0{int(width or 1)}d}"


def _rate(pattern: str | Path, rate: float | None) -> float:
    if rate is None:
        logger.info(
            "%s does not say how many frames a second has; 30 are assumed (fps=… for another number).",
            shown(pattern),
        )
        return ASSUMED_RATE
    return rate
