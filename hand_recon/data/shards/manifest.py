"""Manifest of a folder of shards: their names, sizes, checksums and counts, and how they were made."""

import json
import re
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from hand_recon.data.shards.index import CURE
from hand_recon.reading.naming import OTHER_FORM

MANIFEST: Final = "shards.json"
"""Name of the manifest in its folder."""

FORMAT: Final = "hand_recon.shards/1"
"""Value of the manifest's key `format`."""

LARGEST_MANIFEST: Final = 1 << 28
"""Most bytes of a manifest that are read: 256 MiB, some half a million shards."""

_NAME: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,200}")
_SUM: Final = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class ShardFile:
    """A file of a shard.

    Raises:
        ValueError: The name is a path, or the checksum cannot be one.
    """

    name: str
    """Name without folders."""
    bytes: int
    """Size."""
    sha256: str
    """SHA-256 of the content, 64 hex digits."""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(f"the name {self.name!r}, expected one without folders")
        if not _SUM.fullmatch(self.sha256):
            raise ValueError(f"the checksum {self.sha256!r}, expected 64 hex digits")

    @classmethod
    def from_json(cls, entry: Any) -> "ShardFile":  # noqa: ANN401  # any JSON
        """Read what `dataclasses.asdict` gave."""
        return cls(str(entry["name"]), _count(entry["bytes"]), str(entry["sha256"]))


@dataclass(frozen=True)
class Shard:
    """A tar file of images and labels, and its index."""

    tar: ShardFile
    """Images and labels."""
    index: ShardFile
    """Array of `hand_recon.data.shards.index.INDEX`."""
    images: int
    """Number of images."""
    hands: int
    """Number of hands."""

    @classmethod
    def from_json(cls, entry: Any) -> "Shard":  # noqa: ANN401  # any JSON
        """Read what `dataclasses.asdict` gave."""
        tar, index = (ShardFile.from_json(entry[key]) for key in ("tar", "index"))
        return cls(tar, index, _count(entry["images"]), _count(entry["hands"]))


@dataclass(frozen=True)
class Manifest:
    """Contents of a folder of shards."""

    name: str
    """Name of the dataset."""
    around: str
    """Kind of the hands' boxes: `joints` or `box`, as of `LandmarkRecipe.crop`."""
    groups: int
    """Number of groups of images that stay in one split."""
    shards: tuple[Shard, ...]
    """The shards in order."""
    landmark_set: str | None = None
    """Landmark set that the labels follow; None if it was not said."""
    about: dict[str, Any] = field(default_factory=dict)
    """Parameters, counts and names of images that are left out; for readers, not for programs."""

    @property
    def hands(self) -> int:
        """Number of hands."""
        return sum(shard.hands for shard in self.shards)

    def to_json(self) -> str:
        """The manifest as text, a shard to a line."""
        head = {
            "format": FORMAT, "name": self.name, "around": self.around, "landmark_set": self.landmark_set,
            "groups": self.groups, "images": sum(shard.images for shard in self.shards),
            "hands": self.hands, "about": self.about,
        }  # fmt: skip
        shards = ",\n".join(json.dumps(asdict(shard)) for shard in self.shards)
        return (
            f'{json.dumps(head, ensure_ascii=False, indent=1)[:-2]},\n "shards": [\n{shards}\n]}}\n'
        )


def read_manifest(content: bytes, where: str) -> Manifest:
    """Read a manifest.

    Args:
        content: The file.
        where: Its path or URL, for messages.

    Raises:
        ValueError: It is no manifest, or one of another version.
    """
    try:
        found = json.loads(content)
        if found.get("format") != FORMAT:
            raise ValueError(f"the format {found.get('format')!r}, expected {FORMAT!r}")
        manifest = Manifest(
            name=str(found["name"]),
            around=str(found["around"]),
            groups=_count(found["groups"]),
            shards=tuple(map(Shard.from_json, found["shards"])),
            landmark_set=None if found["landmark_set"] is None else str(found["landmark_set"]),
            about=dict(found["about"]),
        )
        _check_groups(manifest)
        return manifest
    except OTHER_FORM as error:
        raise ValueError(
            f"{where} is no manifest of shards: it has {type(error).__name__} {error}. {CURE}"
        ) from error


def _check_groups(manifest: Manifest) -> None:
    """Refuse more groups than the hands can be in: splitting takes memory for each.

    An image that is left out had a group, too, so that the split is that of the files.

    Raises:
        ValueError: There are more.
    """
    left_out = manifest.about.get("unreadable", ())
    most = manifest.hands + (len(left_out) if isinstance(left_out, list) else 0)
    if manifest.groups > most:
        raise ValueError(
            f"{manifest.groups:,} groups, expected at most {most:,}: one for each hand"
        )


def _count(value: object) -> int:
    """A whole number above zero."""
    if type(value) is not int or value < 1:
        raise ValueError(f"the count {value!r}, expected a whole number above zero")
    return value


def manifest_of_folder(folder: Path) -> Path:
    """Path of the manifest of a folder of shards.

    Args:
        folder: The folder, or the manifest in it.

    Raises:
        FileNotFoundError: There is none.
    """
    path = folder / MANIFEST if folder.is_dir() else folder
    if not path.is_file():
        raise FileNotFoundError(
            f"No manifest of shards at {path}. Make shards with hand-recon prepare shards labels=<file> "
            "images=<folder> output=<folder>; one that was interrupted goes on with the same command."
        )
    return path
