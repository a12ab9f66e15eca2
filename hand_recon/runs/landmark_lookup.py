"""Landmarks of a user's file in the place of a detector: `detector=landmarks`."""

from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np
from jaxtyping import Float, UInt8
from omegaconf import DictConfig

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.detection.box_files import named_image
from hand_recon.detection.detector import DetectedHand, Detections


class FileLandmarks:
    """Looks up the hands of an image in a file of landmarks, by the image's path or file name."""

    name: Final = "landmarks"

    def __init__(self, file: Path, landmarks: ImageLandmarks) -> None:
        """Keep the hands that belong to images.

        Args:
            file: The file, for messages.
            landmarks: Its hands.

        Raises:
            ValueError: No hand names its image.
        """
        self.file, self.landmarks = file, landmarks
        self.hands: dict[PurePosixPath, list[int]] = {}
        for hand, image in enumerate(landmarks.images):
            if image is not None:
                name = PurePosixPath(image.absolute().as_posix())
                self.hands.setdefault(name, []).append(hand)
        if not self.hands:
            raise ValueError(
                f"{file}: no hand names its image, so that the hands of an image cannot be looked up. Write "
                "`image` for each hand, or use `hand-recon fit` on this file."
            )
        self.folder = file.absolute().parent

    @classmethod
    def from_config(cls, config: DictConfig) -> "FileLandmarks":
        """Read the file that `detector.landmarks` names.

        Raises:
            ValueError: None is named.
        """
        given = None if "landmarks" not in config else config._get_node("landmarks")
        if given is None or given._is_missing() or config.landmarks is None:
            raise ValueError(
                "detector=landmarks needs a file; give it with detector.landmarks=<file> (JSON, CSV and the "
                "files of common detectors)."
            )
        file = Path(config.landmarks).expanduser()
        return cls(file, read_landmarks(file))

    def __call__(
        self, image: UInt8[np.ndarray, "height width 3"], file: Path | None = None
    ) -> Detections:
        """The hands of an image.

        Args:
            image: RGB; not looked at.
            file: File of the image.
        """
        del image
        if file is None:
            return Detections()
        found = self._found(file)
        if not found:
            return Detections(dropped=(f"no hand in {self.file} names this image",))
        return Detections(hands=tuple(self._hand(hand) for hand in found))

    def _found(self, file: Path) -> list[int]:
        """Hands of an image: by its whole path, else by the end of it that the file names.

        Raises:
            ValueError: Several images of the file could be this one.
        """
        whole = PurePosixPath(file.absolute().as_posix())
        if whole in self.hands:
            return self.hands[whole]
        # The file's own folder is no part of the names in it, if the images are elsewhere.
        short = {self._relative(name): hands for name, hands in self.hands.items()}
        name = named_image(self.file, list(short), file)
        return [] if name is None else short[name]

    def _relative(self, name: PurePosixPath) -> PurePosixPath:
        own = PurePosixPath(self.folder.as_posix())
        return name.relative_to(own) if name.is_relative_to(own) else name

    def _hand(self, hand: int) -> DetectedHand:
        landmarks = self.landmarks
        points = landmarks.landmarks_2d[hand].masked_fill(
            ~landmarks.labelled[hand, :, None], float("nan")
        )
        return DetectedHand(
            landmarks_2d=points.numpy(),
            side="left" if bool(landmarks.left[hand]) else "right",
            score=None,
            side_score=1.0,
            confidence=None if landmarks.confidence is None else landmarks.confidence[hand].numpy(),
            sigma=None if landmarks.sigma is None else landmarks.sigma[hand].numpy(),
            box=_box_of(landmarks, hand),
        )


def _box_of(landmarks: ImageLandmarks, hand: int) -> Float[np.ndarray, "4"] | None:
    """Box that a file gives for a hand; None without one."""
    boxes = landmarks.hand_boxes
    return None if boxes is None or not bool(boxes[hand].isfinite().all()) else boxes[hand].numpy()
