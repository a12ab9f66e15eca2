"""Parsers for fuzzing: the readers of files, in memory, and parsers that take bytes."""

import io
import math
import tempfile
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from hand_recon.command_line.user_errors import USER_ERRORS
from hand_recon.data.images import decode_image
from hand_recon.detection.tracking import TrackerState
from hand_recon.hand.mano.inert_pickle import load_inert
from hand_recon.hand.mano.pickled_arrays import NUMPY_NAMES, to_array
from hand_recon.reading.archives import load_array, load_arrays
from hand_recon.reading.image_header import announced_pixels
from hand_recon.reading.limits import Limits
from hand_recon.reading.text import parse_json, parse_yaml
from hand_recon.runs.clip.found_frames import FoundFrame
from tests.support.broken_files import CONTENTS, Kind
from tests.support.file_readers import READERS as TEXTS
from tests.support.file_readers import FileReader
from tests.support.inert_pickles import HOSTILE_PICKLES
from tests.support.label_faults import fault_of_labels, zeros_in
from tests.support.network_readers import READERS as NETWORKS

LEFT_OUT: Final = ("checkpoint", "weights", "MANO, pickle", "MANO, zip", "MANO", "video", "lifter")
"""Readers of large files, or of decoders in C that a fuzzer of Python cannot look into."""

NAME: Final = "input"
"""Name that errors about bytes in memory have to hold."""


@dataclass(frozen=True)
class Parser:
    """A function of bytes that a fuzzer calls."""

    name: str
    """Name in the table."""
    parse: Callable[[bytes], object]
    """The function."""
    seeds: Callable[[], list[bytes]]
    """Function that makes the inputs to begin with."""
    share: float = 1.0
    """Share of the time; a cheap parser gets more executions out of it."""
    named: str = NAME
    """Text that every error must hold."""
    is_text: bool = True
    """True if numbers are written as text, so that labels of zero can be compared with the input's zeros."""


@dataclass
class Outcome:
    """End of reading one input."""

    accepted: bool
    """True if it was read."""
    end: str
    """Place in the code and message, equal for alike ends."""
    finding: str = ""
    """Description of what should not be; empty for a clear error and for a result."""


def outcome_of(parser: Parser, content: bytes) -> Outcome:
    """Call a parser; everything but a clear error that names its input, and a result, is a finding."""
    try:
        found = parser.parse(content)
    except USER_ERRORS as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        unnamed = "" if parser.named in str(error) else f"unnamed: {str(error)[:200]}"
        end = f"{place.filename}:{place.lineno} {type(error).__name__}{unnamed[:40]}"
        return Outcome(False, end, unnamed)
    except Exception as error:  # noqa: BLE001  # whatever a fuzzer finds
        place = traceback.extract_tb(error.__traceback__)[-1]
        end = f"{place.filename}:{place.lineno} {type(error).__name__}"
        return Outcome(False, end, f"{type(error).__name__}: {str(error)[:200]} at {end}")
    zeros = zeros_in(content) if parser.is_text else math.inf
    return Outcome(True, f"read {type(found).__name__}", fault_of_labels(found, zeros))


@cache
def _memory() -> Path:
    """A folder in memory, where the system has one; it lasts as long as the process."""
    place = "/dev/shm" if Path("/dev/shm").is_dir() else None  # noqa: S108
    folder = tempfile.TemporaryDirectory(dir=place)
    _FOLDERS.append(folder)
    return Path(folder.name)


_FOLDERS: Final[list[tempfile.TemporaryDirectory[str]]] = []


def _of_reader(reader: FileReader) -> Parser:
    @cache
    def path() -> Path:
        file = _memory() / reader.name.replace(" ", "_") / reader.place
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(reader.content())
        reader.beside(file)
        return file

    def parse(content: bytes) -> object:
        path().write_bytes(content)
        return reader.read(path())

    def seeds() -> list[bytes]:
        valid = reader.content()
        return [valid, *_damaged(valid, reader.kind)]

    name = Path(reader.place).name
    return Parser(reader.name, parse, seeds, 1.0, name, reader.kind != "binary")


def _damaged(valid: bytes, kind: Kind) -> list[bytes]:
    changed = (make(valid, kind) for make in CONTENTS.values())
    return [one for one in changed if one]


def _seeds_of(*names: str) -> Callable[[], list[bytes]]:
    readers = TEXTS | NETWORKS

    def seeds() -> list[bytes]:
        return [readers[name].content() for name in names]

    return seeds


def _text(parse: Callable[[str], object]) -> Callable[[bytes], object]:
    return lambda content: parse(content.decode("latin-1"))


def _pickle(content: bytes) -> object:
    try:
        values = load_inert(content, NUMPY_NAMES, 10_000)
    except ValueError as error:
        raise ValueError(f"{NAME} {error}") from error
    for value in values.values():
        try:
            to_array(value)
        except ValueError as error:
            raise ValueError(f"{NAME} {error}") from error
    return values


_STATE: Final = TrackerState((), 1).to_json()
_FRAME: Final = FoundFrame(0, 0.0, (9, 9), (), TrackerState((), 1)).to_line()


def _in_memory() -> list[Parser]:
    def json_seeds() -> list[bytes]:
        return [*_seeds_of("camera, JSON", "boxes")(), b'{"a": [null, true, -1.5e3, "\\u00e9"]}']

    def yaml_seeds() -> list[bytes]:
        merged = b"a: &a {b: 1.5, c: 2}\nd: &d {<<: *a, c: 3}\ne: {<<: [*a, *d], f: 4}\n"
        return [*_seeds_of("camera, YAML", "settings", "DexYCB")(), merged]

    return [
        Parser("JSON", _text(lambda text: parse_json(text, NAME)), json_seeds, 2.0),
        Parser("YAML", _text(lambda text: parse_yaml(text, NAME)), yaml_seeds, 2.0),
        Parser("npy", lambda content: load_array(content, NAME), _seeds_of("landmarks, npy"), 2.0),
        Parser("npz", lambda content: load_arrays(io.BytesIO(content), NAME), _seeds_of("audit, npz"), 2.0),
        Parser("pickle", _pickle, lambda: [*_seeds_of("HO3D")(), *HOSTILE_PICKLES.values()], 2.0),
        Parser(
            "headers of images", announced_pixels,
            _seeds_of("photograph, PNG", "photograph, JPEG", "photograph, WEBP"), 2.0,
        ),
        Parser("images of datasets", decode_image, _seeds_of("photograph, PNG", "photograph, JPEG")),
        Parser("limits", _text(Limits.from_text), lambda: [b"photo_pixels=4e8,array_bytes=9"], 1.0, ""),
        Parser("tracker's state", _text(TrackerState.from_json), lambda: [_STATE.encode()], 2.0, ""),
        Parser("frame's hands", _text(FoundFrame.from_line), lambda: [_FRAME.encode()], 2.0, ""),
    ]  # fmt: skip


PARSERS: Final[dict[str, Parser]] = {
    one.name: one
    for one in (
        *_in_memory(),
        *(_of_reader(reader) for name, reader in (TEXTS | NETWORKS).items() if name not in LEFT_OUT),
    )
}  # fmt: skip
"""Parsers by name."""
