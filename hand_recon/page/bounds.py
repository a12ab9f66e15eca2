"""Bounds of what the page's server takes from a browser."""

from dataclasses import dataclass

from omegaconf import DictConfig


@dataclass(frozen=True)
class Bounds:
    """Largest uploads, and the time that one of them may take."""

    file_bytes: int = 20_000_000
    """Bytes of a file."""
    pixels: int = 50_000_000
    """Pixels of a photograph."""
    frame_bytes: int = 2_000_000
    """Bytes of an image of the webcam."""
    frame_pixels: int = 2_100_000
    """Pixels of an image of the webcam."""
    seconds: float = 30.0
    """Time for one file or image, seconds."""
    waiting: int = 4
    """Files that may wait while another is worked on."""
    hands: int = 12
    """Hands of a file that are fitted."""

    @classmethod
    def from_config(cls, config: DictConfig) -> "Bounds":
        """Bounds of `conf/demo.yaml`.

        Args:
            config: The section `bounds`.

        Raises:
            ValueError: A number is not above zero, or `waiting` is negative.
        """
        waiting = int(config.waiting)
        found = cls(
            file_bytes=round(float(config.megabytes) * 1e6),
            pixels=round(float(config.megapixels) * 1e6),
            seconds=float(config.seconds),
            waiting=waiting,
            hands=int(config.hands),
        )
        if waiting < 0 or min(found.file_bytes, found.pixels, found.seconds, found.hands) <= 0:
            raise ValueError(
                f"Found bounds.megabytes={config.megabytes}, bounds.megapixels={config.megapixels}, "
                f"bounds.seconds={config.seconds}, bounds.waiting={config.waiting} and "
                f"bounds.hands={config.hands}; expected numbers above 0, and waiting 0 or more."
            )
        return found
