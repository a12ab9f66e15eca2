"""A table of annotated hands and its images, with a white dot at each landmark."""

from pathlib import Path

import cv2
import numpy as np

from hand_recon.data.annotations import AnnotatedHands

SIZE = (120, 160)
"""Height and width of the images."""


def annotated(root: Path, left: tuple[bool, ...] = (False, True, True)) -> AnnotatedHands:
    """Hands with a white dot at each landmark; the last two share an image."""
    rng = np.random.default_rng(4)
    hands = len(left)
    landmarks = rng.uniform((-0.03, -0.05, 0.55), (0.07, 0.05, 0.65), (hands, 21, 3))
    intrinsics = np.tile([[500.0, 0.0, 70.0], [0.0, 520.0, 66.0], [0.0, 0.0, 1.0]], (hands, 1, 1))
    on_plane = (landmarks / landmarks[..., 2:]) @ intrinsics.swapaxes(1, 2)
    labels = on_plane[..., :2]
    paths = [root / "a.png"] + [root / "b.png"] * (hands - 1)
    for path in set(paths):
        image = np.zeros((*SIZE, 3), dtype=np.uint8)
        for row in (row for row in range(hands) if paths[row] == path):
            for u, v in labels[row]:
                cv2.circle(image, (int(u), int(v)), 1, (255, 255, 255), -1)
        cv2.imwrite(str(path), image)
    return AnnotatedHands(
        name="dots",
        root=root,
        images=paths,
        fingerprint="1",
        landmarks_2d=labels,
        left=np.array(left),
        intrinsics=intrinsics,
        landmarks_3d=landmarks,
        boxes=np.concatenate([labels.min(axis=1), labels.max(axis=1)], axis=-1),
        surfaces=lambda row: landmarks[row, :5],
    )
