"""Reads and checks FreiHAND's folders.

One part is `training` or `evaluation`: `<part>/rgb/00000000.jpg` …, `<part>_K.json`,
`<part>_xyz.json` and, where present, `<part>_scale.json` and `<part>_verts.json` (Zimmermann et
al., ICCV 2019, version 2).
"""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.camera import project_array
from hand_recon.data.cache import digest
from hand_recon.data.freihand.image_files import (
    ARCHIVES,
    NumberedImages,
    list_images,
    masks_fingerprint,
)
from hand_recon.data.json_arrays import load_json_array

logger = logging.getLogger(__name__)

VERSIONS: Final = ("gs", "hom", "sample", "auto")
"""Green screen and three recolourings: image i + N·v is version v of hand i."""


@dataclass(frozen=True)
class FreiHandPart:
    """One part of a FreiHAND folder, checked."""

    root: Path
    """The folder that holds the annotations."""
    rgb: Path
    """The folder that holds the images."""
    suffix: str
    """Suffix of the image files."""
    versions: tuple[str, ...]
    """Available versions of each hand."""
    fingerprint: str
    """Digest that changes when an image, a mask or a label changes."""
    intrinsics: Float[np.ndarray, "hand 3 3"]
    """Camera matrices, pixels of the image."""
    landmarks: Float[np.ndarray, "hand landmark=21 3"]
    """Camera frame, metres."""

    @property
    def name(self) -> str:
        """`training` or `evaluation`."""
        return self.rgb.parent.name

    def __len__(self) -> int:
        return len(self.landmarks)

    @property
    def images(self) -> NumberedImages:
        """The files of all images."""
        return NumberedImages(self.rgb, self.suffix, len(self) * len(self.versions))

    @property
    def masks(self) -> NumberedImages:
        """Mask files, one per hand for all colourings, white on black; only the training part has them."""
        return NumberedImages(self.rgb.with_name("mask"), ".jpg", len(self))

    def projections(self) -> Float[np.ndarray, "hand landmark=21 2"]:
        """The 2D labels, which FreiHAND does not store: u = K x / z, pixels of the image."""
        return project_array(self.landmarks.astype(np.float64), self.intrinsics)

    def vertices(self, cache_dir: Path | None) -> Float[np.ndarray, "hand vertex 3"] | None:
        """Ground truth surfaces in the camera's frame, metres; None if the file is not there.

        Raises:
            ValueError: There are more or fewer of them than hands.
        """
        path = self.root / f"{self.name}_verts.json"
        if not path.is_file():
            return None
        vertices = load_json_array(path, cache_dir)
        _check_shape(path, vertices, (len(self), None, 3))
        return vertices


def open_part(
    root: Path, part: str, cache_dir: Path | None, rgb_root: Path | None = None
) -> FreiHandPart:
    """Read and check one part.

    Args:
        root: Folder of the annotations.
        part: `training` or `evaluation`.
        cache_dir: Folder of parsed annotations; None parses them every time.
        rgb_root: Folder of the images, if it is another.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: The files contradict each other, or cannot be hands.
    """
    landmarks = load_list(root, part, "xyz", (None, 21, 3), cache_dir)
    intrinsics = load_list(root, part, "K", (len(landmarks), 3, 3), cache_dir)
    _check_landmarks(root / f"{part}_xyz.json", landmarks)
    _check_intrinsics(root / f"{part}_K.json", intrinsics)
    if (root / f"{part}_scale.json").is_file():
        scale = load_list(root, part, "scale", (len(landmarks),), cache_dir)
        _check_scale(root / f"{part}_scale.json", landmarks, scale)
    rgb = (rgb_root or root) / part / "rgb"
    suffix, count, fingerprint = list_images(rgb)
    allowed = len(VERSIONS) if part == "training" else 1
    if count not in [len(landmarks) * versions for versions in range(1, allowed + 1)]:
        multiples = "once to four times" if allowed > 1 else "exactly"
        raise ValueError(
            f"{rgb} holds {count} images, but {root / f'{part}_xyz.json'} annotates "
            f"{len(landmarks)} hands: expected {multiples} as many "
            f"images ({len(landmarks) * allowed} in a full set). Unpack {ARCHIVES[part]} again, or "
            "cut the JSON lists to the images that you have."
        )
    # Masks count for every crop policy, so that changed masks always make a new map of crops.
    masks = masks_fingerprint(rgb.with_name("mask"))
    return FreiHandPart(
        root=root,
        rgb=rgb,
        suffix=suffix,
        versions=VERSIONS[: count // len(landmarks)],
        fingerprint=digest(fingerprint, masks, landmarks, intrinsics),
        intrinsics=intrinsics,
        landmarks=landmarks,
    )


def find_evaluation(root: Path, eval_root: Path | str | None) -> tuple[Path, Path] | None:
    """Find the evaluation part's annotations and images; its archive unpacks beside the other.

    Args:
        root: Folder of the training part.
        eval_root: Folder of the evaluation part, if the user named one.

    Returns:
        Folder of the annotations and folder of `evaluation/rgb`; None if nothing is annotated.
    """
    root = root.expanduser().resolve()
    beside = (root, root.with_name(f"{root.name}_eval"), root / "FreiHAND_pub_v2_eval")
    for folder in beside if eval_root is None else (Path(eval_root).expanduser(),):
        if (folder / "evaluation_xyz.json").is_file():
            return folder, folder if (folder / "evaluation" / "rgb").is_dir() else root
    return None


def load_list(
    root: Path, part: str, kind: str, shape: tuple[int | None, ...], cache_dir: Path | None
) -> Float[np.ndarray, "..."]:
    """Read and check one of a part's lists.

    Args:
        root: Folder of the annotations.
        part: `training` or `evaluation`.
        kind: `xyz`, `K`, `scale` or `mano`.
        shape: Expected shape, with None for any size.
        cache_dir: Folder of parsed annotations.

    Raises:
        FileNotFoundError: It is not there.
        ValueError: It has another shape.
    """
    path = root / f"{part}_{kind}.json"
    if not path.is_file():
        raise FileNotFoundError(_missing(root, path.name, part))
    # The lists are small, and are read at every sample: hold them in memory.
    array = np.array(load_json_array(path, cache_dir))
    _check_shape(path, array, shape)
    return array


def _missing(root: Path, name: str, part: str) -> str:
    """Error message for a missing file."""
    if not root.is_dir():
        return (
            f"No folder {root}. Unpack {ARCHIVES['training']} and set data.root to the folder that "
            "holds training_xyz.json (data/README.md says where to get it), or run data=synthetic, "
            "which needs no files."
        )
    nested = sorted(path.parent for path in root.glob(f"*/{name}"))
    if nested:
        return f"No {name} in {root}, but there is one in {nested[0]}: set data.root={nested[0]}."
    return (
        f"No {name} in {root}. It is part of {ARCHIVES[part]}: unpack that there, or write it in "
        "the same format for your own images (data/README.md)."
    )


def _check_shape(path: Path, array: np.ndarray, shape: tuple[int | None, ...]) -> None:
    wanted = [
        size if size is not None else found for size, found in zip(shape, array.shape, strict=False)
    ]
    if list(array.shape) != wanted or array.ndim != len(shape):
        expected = " × ".join("any" if size is None else str(size) for size in shape)
        landmarks = f"{path.name.rpartition('_')[0]}_xyz.json"
        raise ValueError(
            f"{path} holds an array of {' × '.join(map(str, array.shape))}, expected {expected} "
            f"(one entry per hand of {landmarks}). Take all annotations from the same archive."
        )


def _check_landmarks(path: Path, landmarks: Float[np.ndarray, "hand landmark=21 3"]) -> None:
    """Refuse landmarks that cannot be hands in front of a camera, in metres."""
    _refuse(path, ~np.isfinite(landmarks).all(axis=(1, 2)), "landmarks that are not finite")
    behind = np.any(landmarks[..., 2] <= 0, axis=1)
    _refuse(path, behind, "landmarks at z ≤ 0, behind the camera (OpenGL axes? negate y and z)")
    phalanx = float(np.median(np.linalg.norm(landmarks[:, 9] - landmarks[:, 10], axis=-1)))
    if not 0.005 < phalanx < 0.15:
        raise ValueError(
            f"{path}: the middle finger's proximal phalanx is {phalanx:.4g} long in the median, "
            "expected about 0.03: the unit must be metres and the order of landmarks FreiHAND's."
        )


def _check_intrinsics(path: Path, intrinsics: Float[np.ndarray, "hand 3 3"]) -> None:
    """Refuse matrices that are not camera matrices."""
    focal = intrinsics[:, [0, 1], [0, 1]]
    last_row = np.abs(intrinsics[:, 2] - np.array([0, 0, 1])).max(axis=-1) < 1e-6
    good = np.isfinite(intrinsics).all(axis=(1, 2)) & (focal > 1).all(axis=-1) & last_row
    _refuse(path, ~good, "matrices that are not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels")


def _check_scale(
    path: Path,
    landmarks: Float[np.ndarray, "hand landmark=21 3"],
    scale: Float[np.ndarray, " hand"],
) -> None:
    """Refuse scales that are not the length of the middle finger's proximal phalanx."""
    phalanx = np.linalg.norm(landmarks[:, 9] - landmarks[:, 10], axis=-1)
    wrong = ~(np.abs(phalanx - scale) < 0.01 * phalanx)
    # A few hands may have new annotations; a wrong order or unit affects nearly all of them.
    if wrong.mean() <= 0.01:
        for index in np.flatnonzero(wrong)[:5]:
            logger.warning("%s: entry %d is not the length of its phalanx.", path, index)
        return
    _refuse(path, wrong, "lengths that differ from ‖xyz[9] - xyz[10]‖ (is the order FreiHAND's?)")


def _refuse(path: Path, wrong: np.ndarray, what: str) -> None:
    if wrong.any():
        first = ", ".join(str(index) for index in np.flatnonzero(wrong)[:5])
        raise ValueError(
            f"{path}: {int(wrong.sum())} of {len(wrong)} hands have {what}; the first are {first}. "
            "Correct them or remove them from every list."
        )
