"""Downloads of hands: the file of hands, and every format of other programs, as one file or a zip file."""

import io
import re
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hand_recon.fitting.hand_records import HandRecords
from hand_recon.fitting.hands_file import writing_hands
from hand_recon.formats.by_name import FORMATS, check, format_named
from hand_recon.formats.exported_hands import exported_hands
from hand_recon.hand.model import HandModel

HANDS_JSON: Final = "json"
"""Name of the project's own file of hands among the formats."""


@dataclass(frozen=True)
class Download:
    """A file to send."""

    name: str
    """File name."""
    content: bytes
    """All of its bytes."""


def offered(hand: HandModel) -> list[dict[str, Any]]:
    """Formats in the order in which the page offers them.

    Args:
        hand: The hand model of the page.
    """
    own = {"name": HANDS_JSON, "purpose": "all numbers: the file of hands of hand_recon"}
    others = [
        {"name": one.name, "purpose": one.purpose}
        for one in FORMATS.values()
        if one.is_available and one.hand in (None, hand.name)
    ]
    return [own, *others]


def download(name: str, records: HandRecords, hand: HandModel, stem: str) -> Download:
    """Write hands in a format.

    Args:
        name: `json`, or a key of `FORMATS`.
        records: The hands.
        hand: Model of the right hand.
        stem: Name of the file that the hands were made of.

    Raises:
        ModuleNotFoundError: The format needs a package that is not installed.
        ValueError: The format is unknown, or cannot hold these hands.
    """
    stem = re.sub(r"[^\w-]+", "-", Path(stem).stem).strip("-") or "hands"
    with tempfile.TemporaryDirectory() as folder:
        files = _written(name, records, hand, Path(folder))
        return _one_file(files, f"{stem}_{name}")


def _written(name: str, records: HandRecords, hand: HandModel, folder: Path) -> list[Path]:
    if name == HANDS_JSON:
        path = folder / "hands.json"
        with writing_hands(path) as write:
            write(records)
        return [path]
    chosen = format_named(name)
    hands = exported_hands(records, hand)
    check(chosen, hands)
    return chosen.writer(hands, folder)


def _one_file(files: Sequence[Path], stem: str) -> Download:
    """The only file, or all in a zip file."""
    # Some writers put further files, such as materials, beside those that they return.
    together = sorted({beside for file in files for beside in file.parent.iterdir()})
    if len(together) == 1:
        return Download(together[0].name, together[0].read_bytes())
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in together:
            archive.write(file, file.name)
    return Download(f"{stem}.zip", stream.getvalue())
