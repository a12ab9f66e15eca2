"""One file of encoded crops of hands and their labels, for machines that the photographs are not on.

A crop is stored as the part of it that lies inside of its image, as WebP, with its corner: so the black
outside is exact when it is read, and costs nothing. Labels are hundredths of a pixel of the crop.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

HANDS: Final = "hands.npz"
"""Name of the file of training and test hands."""

IN_3D: Final = "hands_in_3d.npz"
"""Name of the file of test hands with 3D."""

BACKBONE: Final = "backbone.pth"
"""Name of the file of ImageNet weights beside them."""

UNIT: Final = 0.01
"""Resolution of the stored labels, pixels of the crop."""

NONE: Final = np.iinfo(np.int16).min
"""Stored number of a landmark without a label."""

FORMAT: Final = "hand_recon packed hands 1"
"""Name and version of the format."""


@dataclass(frozen=True)
class PackedHands:
    """Encoded crops of right hands, or left ones mirrored, with labels.

    Raises:
        ValueError: Columns differ in length, or a label is too far outside of its crop to be stored.
    """

    size: int
    """Side of a crop, pixels."""
    landmark_set: str
    """Landmark set that the labels follow."""
    names: tuple[str, ...]
    """Image of each hand, by its path in the folder of images."""
    test: Bool[np.ndarray, " hand"]
    """True for test hands."""
    landmarks_2d: Float[np.ndarray, "hand landmark=21 2"]
    """Labels, pixels of the crop; NaN without a label."""
    corners: Int[np.ndarray, "hand 2"]
    """Left and upper edge of the encoded part in the crop, pixels."""
    images: tuple[bytes, ...]
    """Encoded part of each crop."""
    landmarks_3d: Float[np.ndarray, "hand landmark=21 3"] | None = None
    """Ground truth, camera frame, metres; None without any."""

    def __post_init__(self) -> None:
        columns = (self.test, self.landmarks_2d, self.corners, self.images)
        lengths = {len(column) for column in columns} | {len(self.names)}
        if len(lengths) > 1:
            raise ValueError(
                f"Columns of packed hands have the lengths {sorted(lengths)}; expected one."
            )
        limit = -(NONE + 1) * UNIT
        if np.nanmax(np.abs(self.landmarks_2d), initial=0.0) > limit:
            raise ValueError(
                f"A label is more than {limit:.0f} pixels from its crop's corner; leave this hand out."
            )

    def __len__(self) -> int:
        return len(self.names)

    def write(self, path: Path) -> None:
        """Write the file, under another name until it is whole."""
        header = {"format": FORMAT, "size": self.size, "landmark_set": self.landmark_set}
        hundredths = np.round(self.landmarks_2d / UNIT)
        columns = {
            "header": _bytes(json.dumps(header | {"names": self.names})),
            "test": self.test,
            "landmarks_2d": np.where(np.isnan(hundredths), NONE, hundredths).astype(np.int16),
            "corners": self.corners.astype(np.uint16),
            "lengths": np.array([len(image) for image in self.images], np.uint32),
            "images": np.frombuffer(b"".join(self.images), np.uint8),
        }
        if self.landmarks_3d is not None:
            columns["landmarks_3d"] = self.landmarks_3d.astype(np.float32)
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(".partial")
        with unfinished.open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **columns)
        unfinished.rename(path)


def read_packed(path: Path) -> PackedHands:
    """Read a file of `PackedHands.write`.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is of another format.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"No packed hands at {path}. Make them where the photographs are: python -m gpu.pack."
        )
    with np.load(path, allow_pickle=False) as archive:
        columns = {name: archive[name] for name in archive.files}
    header = json.loads(columns["header"].tobytes()) if "header" in columns else {}
    if header.get("format") != FORMAT:
        raise ValueError(
            f"{path} has the format {header.get('format')!r}; expected {FORMAT!r}. Make it again with "
            "python -m gpu.pack."
        )
    hundredths = columns["landmarks_2d"].astype(np.float32)
    content = columns["images"].tobytes()
    ends = np.cumsum(columns["lengths"], dtype=np.int64).tolist()
    return PackedHands(
        size=header["size"],
        landmark_set=header["landmark_set"],
        names=tuple(header["names"]),
        test=columns["test"],
        landmarks_2d=np.where(hundredths == NONE, np.nan, hundredths * UNIT).astype(np.float32),
        corners=columns["corners"].astype(np.int64),
        images=tuple(content[a:b] for a, b in zip([0, *ends], ends, strict=False)),
        landmarks_3d=columns.get("landmarks_3d"),
    )


def group_of(name: str) -> str:
    """First folder in the name of an image; empty for an image that is in none."""
    return name.split("/", 1)[0] if "/" in name else ""


def _bytes(text: str) -> np.ndarray:
    return np.frombuffer(text.encode(), np.uint8)
