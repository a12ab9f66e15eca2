"""Sets of hands with 2D landmarks to fit and 3D landmarks to score against.

`headset_poses` and `stereo_clip` are of living hands, whose files are not part of the repository.
"""

import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.synthetic.dataset import SyntheticHands

SIDES: Final = ("right", "left")
"""Sides in the order in which the headset's files are read."""

WEBXR_ROWS: Final = tuple(row for row in range(25) if row not in {5, 10, 15, 20})
"""The 21 landmarks among the joints of WebXR, without the bases of the four metacarpals."""

SHORTEST_PALM: Final = 0.03
"""Shortest distance from the wrist to the middle MCP that a recorded pose can have, metres."""

FOCAL: Final = 500.0
CENTRE: Final = 112.0
DISTANCE: Final = 0.5
ASIDE: Final = 0.05
"""Made-up cameras: focal length and principal point in pixels, distance of the hand from the camera, and its
largest distance from the optical axis along each image axis, metres."""


@dataclass(frozen=True)
class SecondCamera:
    """Landmarks of the same hands in a second camera, without lens distortion."""

    landmarks_2d: Float[Tensor, "hand landmark=21 2"]
    """Landmarks, pixels of the second camera's image."""
    intrinsics: Float[Tensor, "3 3"]
    """Camera matrix, pixels."""
    rotation: Float[Tensor, "3 3"]
    """Rotation from the first camera's frame to the second's."""
    translation: Float[Tensor, " 3"]
    """Origin of the first camera's frame in the second's, metres."""


@dataclass(frozen=True)
class DepthSet:
    """Hands to fit, with their ground truth."""

    name: str
    """Name for tables."""
    landmarks: ImageLandmarks
    """2D landmarks."""
    ground_truth: Float[Tensor, "hand landmark=21 3"]
    """3D landmarks in any frame, metres; left hands as left hands."""
    groups: tuple[str, ...]
    """Name of the group of each hand. Groups are resampled for intervals, since their hands are alike."""
    second: SecondCamera | None = None
    """A second view of the hands."""
    landmark_set: str | None = None
    """Landmark set of the hand model that the landmarks belong to; none for the fit's default."""

    def __len__(self) -> int:
        return len(self.groups)

    def select(self, hands: Sequence[int]) -> "DepthSet":
        """Some of the hands.

        Args:
            hands: Their positions.
        """
        rows = torch.tensor(hands, dtype=torch.long)
        second = self.second
        if second is not None:
            second = replace(second, landmarks_2d=second.landmarks_2d[rows])
        return replace(
            self,
            landmarks=self.landmarks.select(rows),
            ground_truth=self.ground_truth[rows],
            groups=tuple(self.groups[hand] for hand in hands),
            second=second,
        )


def half_of(name: str) -> str:
    """Half that a named pose belongs to: `a` for choosing settings, `b` for reporting."""
    return "ab"[zlib.crc32(name.encode()) % 2]


def headset_poses(
    folder: Path,
    *,
    seeds: Sequence[int] = (0,),
    noise: float = 3.0,
    views: int = 2,
    half: str = "both",
) -> DepthSet:
    """Read poses of a living hand that a headset recorded, seen by random made-up cameras.

    Cameras are known: `FOCAL`, in any direction, `DISTANCE` away. A group is a named pose with both sides and
    all of its views.

    Args:
        folder: Folder with `poses_right.json` and `poses_left.json` of stewdio/handy.js (MIT), joints in
            the order of WebXR and millimetres.
        seeds: Seeds of cameras and noise; each gives as many views of every pose as `views` says.
        noise: Standard deviation of each coordinate of a landmark, pixels.
        views: Views of each pose and seed.
        half: `a` or `b`, the half of the named poses that `half_of` says, or `both`.

    Raises:
        FileNotFoundError: The folder has no such files.
        ValueError: There is no pose in the half.
    """
    poses = _recorded_poses(folder)
    seen, points, names, left, groups = [], [], [], [], []
    for seed in seeds:
        random = np.random.default_rng(seed)
        for name, side, pose in poses:
            for view in range(views):
                placed = _before_camera(pose, random)
                pixels = FOCAL * placed[:, :2] / placed[:, 2:] + CENTRE
                pixels += random.normal(size=(21, 2)) * noise
                if half not in ("both", half_of(name)):
                    continue
                # Two decimals, as detectors write them to files.
                seen.append(pixels.round(2))
                points.append(placed)
                names.append(f"{name}_{side}_{view}" + (f"_{seed}" if len(seeds) > 1 else ""))
                left.append(side == "left")
                groups.append(name)
    if not seen:
        raise ValueError(f"Found no pose of half={half} in {folder}; expected half=a, b or both.")
    landmarks = _landmarks(np.array(seen), names, np.array(left), _camera())
    return DepthSet("headset", landmarks, torch.from_numpy(np.array(points)), tuple(groups))


def _recorded_poses(folder: Path) -> list[tuple[str, str, Float[np.ndarray, "landmark=21 3"]]]:
    """Name, side and landmarks of each pose; metres, OpenCV's axes, with the middle MCP at the origin."""
    poses = []
    for side in SIDES:
        file = folder / f"poses_{side}.json"
        if not file.is_file():
            raise FileNotFoundError(
                f"No {file.name} in {folder}; expected the recorded poses of stewdio/handy.js "
                "(poses_left.json and poses_right.json). Name their folder."
            )
        for row in json.loads(file.read_text(encoding="utf-8")):
            points = np.array(row["jointPositions"], dtype=float)[list(WEBXR_ROWS)] / 1000
            # WebXR's y points up and its z to the viewer.
            points *= [1.0, -1.0, -1.0]
            palm = np.linalg.norm(points[9] - points[0])
            if np.isfinite(points).all() and palm >= SHORTEST_PALM:
                poses.append((str(row["names"][0]), side, points - points[9]))
    return poses


def _before_camera(
    pose: Float[np.ndarray, "landmark=21 3"], random: np.random.Generator
) -> Float[np.ndarray, "landmark=21 3"]:
    """Rotate a pose at random and put it before the camera."""
    w, x, y, z = _unit(random.normal(size=4))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return pose @ rotation.T + [*random.uniform(-ASIDE, ASIDE, size=2), DISTANCE]


def _unit(vector: Float[np.ndarray, " axis"]) -> Float[np.ndarray, " axis"]:
    return vector / np.linalg.norm(vector)


def _camera() -> Float[np.ndarray, "3 3"]:
    return np.array([[FOCAL, 0.0, CENTRE], [0.0, FOCAL, CENTRE], [0.0, 0.0, 1.0]])


def _landmarks(
    points: Float[np.ndarray, "hand landmark=21 2"],
    names: Sequence[str],
    left: np.ndarray,
    camera: Float[np.ndarray, "3 3"],
) -> ImageLandmarks:
    seen = torch.from_numpy(points)
    return ImageLandmarks(
        landmarks_2d=seen,
        labelled=torch.ones(seen.shape[:2], dtype=torch.bool),
        left=torch.from_numpy(left),
        names=tuple(names),
        intrinsics=torch.from_numpy(camera).expand(len(seen), 3, 3).clone(),
    )


def synthetic_views(
    count: int, cache: Path, *, seed: int = 0, camera: bool = True, split: str = "test"
) -> DepthSet:
    """Views of synthetic hands; those of `test` have held-out gestures, as `hand-recon fit data=views`.

    Args:
        count: Number of hands; each is a group of its own.
        cache: Folder for the views.
        seed: Seed of the set.
        camera: False hides the cameras, so that a fit assumes one.
        split: `test` or `val`.
    """
    views = SyntheticHands(
        split, count, 224, "hard", seed=seed, cache_dir=cache, pictures=False, with_vertices=False
    )
    batch = views.batch(list(range(count)))
    if batch.landmarks_3d is None or batch.intrinsics is None or batch.confidence is None:
        raise ValueError(
            "Found views without 3D landmarks, cameras or confidences; expected all three."
        )
    names = tuple(f"views_{place:05d}" for place in range(count))
    landmarks = ImageLandmarks(
        landmarks_2d=batch.landmarks_2d.double(),
        labelled=batch.labelled,
        left=torch.zeros(count, dtype=torch.bool),
        names=names,
        confidence=batch.confidence.double(),
        intrinsics=batch.intrinsics.double() if camera else None,
    )
    name = "synthetic" if camera else "synthetic, no camera"
    return DepthSet(
        name, landmarks, batch.landmarks_3d.double(), names, landmark_set=views.recipe.landmark_set
    )
