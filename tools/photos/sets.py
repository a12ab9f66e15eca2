"""Photographs of hands as a model sees them: crops with labels, groups, and 3D where a clip has it."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from jaxtyping import Float
from torch import Tensor

from depth.sets import SecondCamera
from depth.stereo import stereo_clip
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.dataset import HandDataset, load_batch
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits
from hand_recon.detection.detector import DetectedHand
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.runs.photo_crops import frame_of, sample_of
from hand_recon.schema import HandBatch, collate
from landmark_noise.clip import video_frames

PALM: Final = tuple(
    LANDMARKS.index(name)
    for name in ("wrist", "thumb CMC", "index MCP", "middle MCP", "ring MCP", "little MCP")
)
"""Landmarks whose convex hull is taken for the palm."""

SIDE_VIEW: Final = 0.45
"""Width of the palm (index to little MCP) over its length (wrist to middle MCP) under which a hand is
seen from the side; that of a flat hand is 0.7."""

DARK: Final = 45.0
"""CIE lightness L* of the palm, 0 to 100, under which it counts as dark, by skin or by light."""


@dataclass(frozen=True)
class PhotoSet:
    """Photographs with one hand each."""

    name: str
    """Name for tables."""
    batch: HandBatch
    """Crops, as bytes, with their labels."""
    groups: dict[str, tuple[str, ...]]
    """Groups of each photograph by kind of grouping; an empty string for none."""
    blocks: tuple[str, ...]
    """Photographs with the same name are alike and are resampled together."""
    second: SecondCamera | None = None
    """A second view."""
    one_person: bool = False
    """True if all hands are one person's."""

    def __len__(self) -> int:
        return len(self.blocks)


def labelled_photographs(labels: Path, images: Path, size: int, expansion: float) -> PhotoSet:
    """Read photographs with labels; groups are folders, gestures, views and lightness.

    A gesture is the first word of a file's name (`rock_1a2b.jpg`), or a digit, or the second word where
    the first names a part of the set (`testing_rock.1a2b.jpg`).

    Args:
        labels: File of landmarks.
        images: Folder of the photographs.
        size: Side of the crops, pixels.
        expansion: Side of the crops as a multiple of the landmarks' box.
    """
    recipe = LandmarkRecipe(
        labels,
        test=labels,
        images=images,
        crop=CropPolicy(size=size, around="joints", expansion=expansion),
        reading=ReadingPolicy(None, decode_cache=False),
    )
    batch = _whole(LandmarkSplits(recipe).dataset("test"))
    names = [Path(source) for source in batch.source]
    width = _palm_width(batch.landmarks_2d)
    lightness = _lightness(batch)
    kinds = {
        "folder": tuple(name.parent.name for name in names),
        "gesture": tuple(f"{name.parent.name}/{_gesture(name)}" for name in names),
        "view": tuple("side" if value < SIDE_VIEW else "" for value in width),
        "lightness": tuple("dark" if value < DARK else "" for value in lightness),
        "fist": tuple(
            "fist"
            if (_gesture(name) in ("fist", "rock") and name.parent.name != "gestures")
            or _gesture(name) == "fist"
            else ""
            for name in names
        ),
    }
    return PhotoSet("photographs", batch, kinds, batch.source)


def clip_photographs(folder: Path, size: int, expansion: float, every: int = 1) -> PhotoSet:
    """Frames of the first camera of a clip by two cameras, with triangulated landmarks.

    Args:
        folder: Folder of `cam0.mp4`, `calibration.json` and `landmarks.npz` (`depth.stereo.stereo_clip`).
        size: Side of the crops, pixels.
        expansion: Side of the crops as a multiple of the landmarks' box.
        every: Step between frames.
    """
    hands = stereo_clip(folder, every=every)
    numbers = [int(name.split()[-1]) for name in hands.landmarks.names]
    camera = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))["cam0"]
    matrix, distortion = np.array(camera["K"]), np.array(camera["distortion"])
    # The clip's landmarks are without lens distortion, so its frames have to be, too.
    frames = [
        cv2.undistort(frame, matrix, distortion) for frame in _frames(folder / "cam0.mp4", numbers)
    ]
    policy = CropPolicy(size=size, around="joints", expansion=expansion)
    batch = _cut(frames, hands.landmarks.landmarks_2d.numpy(), policy, matrix)
    batch = replace(batch, landmarks_3d=hands.ground_truth.float(), source=hands.landmarks.names)
    return PhotoSet("clip", batch, {}, hands.groups, hands.second, one_person=True)


def _whole(dataset: HandDataset) -> HandBatch:
    return load_batch(dataset, list(range(len(dataset))))


def _frames(video: Path, numbers: list[int]) -> list[np.ndarray]:
    """Frames of a video by number, RGB.

    Raises:
        ValueError: The video has too few frames.
    """
    frames = list(video_frames(video))
    if max(numbers) >= len(frames):
        raise ValueError(
            f"{video} has {len(frames)} frames; expected more than {max(numbers)}, as its landmarks have."
        )
    return [frames[number] for number in numbers]


def _cut(
    frames: list[np.ndarray], points: np.ndarray, policy: CropPolicy, camera: np.ndarray
) -> HandBatch:
    """Crops of right hands about their landmarks."""
    samples = []
    for number, (frame, landmarks) in enumerate(zip(frames, points, strict=True)):
        hand = DetectedHand(landmarks.astype(float), "right", None, 1.0)
        sample, _ = sample_of(frame, hand, frame_of(hand, "joints"), policy, camera)
        samples.append(replace(sample, index=number))
    return collate(samples)


def _gesture(name: Path) -> str:
    """Gesture in a file's name."""
    words = name.stem.replace(".", "_").split("_")
    if words[0] in ("training", "testing"):
        return words[1]
    if words[0].isdigit():
        return words[0]
    return "_".join(word for word in words[:-1] if word.isalpha()) or words[0]


def _palm_width(landmarks: Float[Tensor, "hand landmark=21 2"]) -> list[float]:
    """Width of each palm over its length."""
    index, middle, little = (
        LANDMARKS.index(f"{finger} MCP") for finger in ("index", "middle", "little")
    )
    across = (landmarks[:, index] - landmarks[:, little]).norm(dim=-1)
    along = (landmarks[:, middle] - landmarks[:, LANDMARKS.index("wrist")]).norm(dim=-1)
    found: list[float] = (across / along.clamp(min=1e-6)).tolist()
    return found


def _lightness(batch: HandBatch) -> list[float]:
    """Median CIE lightness of each palm, 0 to 100."""
    found = []
    for image, points in zip(batch.image, batch.landmarks_2d, strict=True):
        pixels = np.ascontiguousarray(image.permute(1, 2, 0).numpy())
        hull = cv2.convexHull(points[list(PALM)].round().int().numpy())
        mask = cv2.fillConvexPoly(np.zeros(pixels.shape[:2], np.uint8), hull, 1)
        light = cv2.cvtColor(pixels, cv2.COLOR_RGB2LAB)[..., 0][mask == 1]
        found.append(100 / 255 * float(np.median(light)) if light.size else float("nan"))
    return found
