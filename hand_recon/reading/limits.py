"""Limits of the files that are read, in one place; HAND_RECON_LIMITS in the environment changes them.

    HAND_RECON_LIMITS=photo_pixels=4e8,array_bytes=2e10 hand-recon predict panorama.tif

They are well above what hands need and below what fills the memory of a small machine (decision 92).
"""

import math
import os
from dataclasses import dataclass, fields
from typing import Final

VARIABLE: Final = "HAND_RECON_LIMITS"
"""Name of the environment variable: `name=number`, separated by commas."""


@dataclass(frozen=True)
class Limits:
    """Largest sizes that are read."""

    photo_pixels: int = 210_000_000
    """Pixels of a photograph: a little more than the 200 megapixels of the largest cameras of telephones."""
    image_pixels: int = 210_000_000
    """Pixels of an image of a dataset."""
    frame_pixels: int = 70_000_000
    """Pixels of a frame of a video; 8K has 33 million."""
    text_bytes: int = 4 * 2**30
    """Bytes of a file of text that is read as a whole; a million hands take 2e9 as hands.json."""
    array_bytes: int = 8 * 2**30
    """Bytes of the arrays of a file, unpacked."""
    yaml_values: int = 1_000_000
    """Values of a YAML file, each counted as often as it is referred to."""

    @classmethod
    def from_text(cls, text: str) -> "Limits":
        """Limits with those of a text in place of the defaults.

        Args:
            text: `name=number`, separated by commas; the defaults if it is empty.

        Raises:
            ValueError: A name is unknown, or a number is none above zero.
        """
        known = [field.name for field in fields(cls)]
        given = {}
        for part in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = part.partition("=")
            number = _number(value)
            if name not in known or number is None:
                raise ValueError(
                    f"Found {part!r} in {VARIABLE}; expected <name>=<number above 0>, with a name of "
                    f"{', '.join(known)}. Correct it, or remove the variable from the environment."
                )
            given[name] = number
        return cls(**given)


def _number(text: str) -> int | None:
    """A finite number above zero, rounded; None for anything else."""
    try:
        number = float(text)
    except ValueError:
        return None
    return round(number) if math.isfinite(number) and number >= 1 else None


LIMITS: Final = Limits.from_text(os.environ.get(VARIABLE, ""))
"""Limits of this process."""


def too_large(path: object, found: int, name: str, unit: str) -> str:
    """Message about a file above a limit.

    Args:
        path: The file.
        found: Size of it.
        name: Field of `Limits`.
        unit: Unit of both, in the plural.
    """
    limit = getattr(LIMITS, name)
    return (
        f"{path} has {found:,} {unit}; expected at most {limit:,}. If the file is as it should be, set "
        f"{VARIABLE}={name}={found} in the environment."
    )
