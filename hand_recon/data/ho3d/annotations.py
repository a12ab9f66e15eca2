"""Reads all annotations of a part of HO3D into a few arrays; 83,325 pickles are read once, then cached."""

import logging
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.data.cache import digest, ensure_built
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.ho3d.files import Ho3dPart
from hand_recon.data.ho3d.metas import Meta, read_meta
from hand_recon.data.progress import with_progress
from hand_recon.hand.skeleton import landmark_permutation

logger = logging.getLogger(__name__)

OPENGL: Final = np.array([1.0, -1.0, -1.0])
"""Signs that convert between HO3D's camera axes (y up, view along −z) and this project's."""

TO_FREIHAND: Final = list(landmark_permutation("ho3d", "freihand"))
"""Indices that reorder landmarks from HO3D's order to this project's."""

FORMAT: Final = 1
"""Version of the cached arrays."""

_MANO: Final[dict[str, tuple[int, ...]]] = {"handPose": (48,), "handBeta": (10,), "handTrans": (3,)}


@dataclass(frozen=True)
class Annotations:
    """Annotations, one row per frame of the list, as in the files; NaN where a frame has none."""

    intrinsics: Float[np.ndarray, "frame 3 3"]
    """Camera matrices, pixels of the image."""
    joints: Float[np.ndarray, "frame joint 3"]
    """All 21 in HO3D's order for training, the wrist alone for evaluation; OpenGL's axes, metres."""
    boxes: Float[np.ndarray, "frame 4"]
    """Left, top, right and bottom, pixels: evaluation only."""
    mano: Float[np.ndarray, "frame number=61"]
    """Absolute axis angles 48, shape 10 and translation 3, OpenGL's axes: training only."""

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def annotated(self) -> Bool[np.ndarray, " frame"]:
        """True for frames with an annotation."""
        return np.isfinite(self.joints).all(axis=(1, 2)) & np.isfinite(self.intrinsics).all(
            axis=(1, 2)
        )

    @property
    def points(self) -> Float[np.ndarray, "frame joint 3"]:
        """Joints in this project's axes and, where there are 21, order; metres."""
        points = self.joints * OPENGL
        return points[:, TO_FREIHAND] if points.shape[1] == 21 else points


def read_annotations(part: Ho3dPart, reading: ReadingPolicy) -> Annotations:
    """The annotations of a part, from the cache if there is one.

    Args:
        part: Part to read; missing frames are NaN.
        reading: Folder of caches and number of reading threads.

    Raises:
        RefusedMetaError: A file is damaged or asks for what no annotation needs.
    """
    if reading.folder is None:
        return _read_all(part, reading.workers)

    def build(folder: Path) -> None:
        logger.info("Reading %d annotations once into %s", int(part.present.sum()), target)
        for name, array in vars(_read_all(part, reading.workers)).items():
            np.save(folder / f"{name}.npy", array)

    target = reading.folder / f"ho3d-{part.name}-annotations-{digest(FORMAT, part.fingerprint)}"
    ensure_built(target, build)
    return Annotations(
        *(
            np.load(target / f"{field.name}.npy", allow_pickle=False)
            for field in fields(Annotations)
        )
    )


def _read_all(part: Ho3dPart, workers: int) -> Annotations:
    training, count = part.name == "train", len(part)
    arrays = Annotations(
        intrinsics=np.full((count, 3, 3), np.nan),
        joints=np.full((count, 21 if training else 1, 3), np.nan),
        boxes=np.full((count, 4), np.nan),
        mano=np.full((count, 61), np.nan),
    )
    rows = np.flatnonzero(part.present).tolist()
    for row, meta in zip(rows, _read_metas(part, rows, workers), strict=True):
        intrinsics = meta.numbers("camMat", (3, 3))
        joints = meta.numbers("handJoints3D", (21, 3) if training else (3,))
        if intrinsics is None or joints is None:
            continue
        arrays.intrinsics[row], arrays.joints[row] = intrinsics, joints
        if training:
            arrays.mano[row] = _mano_numbers(meta)
        else:
            box = meta.numbers("handBoundingBox", (4,))
            arrays.boxes[row] = np.nan if box is None else box
    return arrays


def _read_metas(part: Ho3dPart, rows: list[int], workers: int) -> Iterator[Meta]:
    # Disk latency dominates, so several threads read at once.
    with ThreadPoolExecutor(max(1, workers)) as pool:
        metas = pool.map(lambda row: read_meta(part.meta(row)), rows)
        yield from with_progress(metas, len(rows), "Reading annotations")


def _mano_numbers(meta: Meta) -> Float[np.ndarray, " number=61"]:
    """MANO's pose, shape and translation; NaN where the meta file has none."""
    parts = [meta.numbers(key, shape) if key in meta else None for key, shape in _MANO.items()]
    if any(part is None for part in parts):
        return np.full(61, np.nan)
    return np.concatenate([part for part in parts if part is not None])
