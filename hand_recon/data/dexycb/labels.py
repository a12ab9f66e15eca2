"""DexYCB's labels, one small archive per image, read once into three arrays.

`joint_2d` is the projection of `joint_3d` by the colour camera's matrix, as FreiHAND's labels are, and is
taken as it is: no half pixel is added, although the camera's maker counts pixels from their centres.
"""

import io
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from hand_recon.camera import project_array
from hand_recon.data.cache import ensure_built
from hand_recon.data.dexycb.files import label_path
from hand_recon.data.dexycb.listing import FrameFiles, Task, digest_files, tasks_of
from hand_recon.data.dexycb.splits import Frames
from hand_recon.data.processes import single_threaded_processes
from hand_recon.data.progress import with_progress
from hand_recon.reading.archives import load_arrays

logger = logging.getLogger(__name__)

SHAPES: Final = {"joint_2d": (21, 2), "joint_3d": (21, 3), "pose_m": (51,)}
"""Arrays that are read from a label file, and their shapes behind an axis of one hand."""

MISSING: Final = -1.0
"""Value of unlabelled joints."""

WORTH_PROCESSES: Final = 10_000
"""Smallest number of files for which more processes pay off; one reads about 2,000 per second."""

_LOOKED_AT: Final = 20_000
"""Approximate number of labels that are checked; mistakes are in all of them or in none."""

_TOO_FAR: Final = 1.0
"""Largest distance of a label from its projection, pixels; rounding explains less."""


@dataclass(frozen=True)
class DexYcbLabels:
    """The labels of some frames."""

    joint_2d: Float[np.ndarray, "frame landmark=21 2"]
    """Pixels of the whole image, also outside it."""
    joint_3d: Float[np.ndarray, "frame landmark=21 3"]
    """Camera's frame, metres."""
    pose_m: Float[np.ndarray, "frame number=51"]
    """MANO's global rotation 3, coefficients of pose components 45 and translation 3."""

    def __len__(self) -> int:
        return len(self.pose_m)

    def select(self, rows: Int[np.ndarray, " row"]) -> "DexYcbLabels":
        """Labels of some frames."""
        return DexYcbLabels(self.joint_2d[rows], self.joint_3d[rows], self.pose_m[rows])

    def unlabelled(self) -> dict[str, Bool[np.ndarray, " frame"]]:
        """Frames without a hand, by each value that marks them."""
        return {
            "joint_3d is −1": (self.joint_3d == MISSING).all(axis=(1, 2)),
            "joint_2d is −1": (self.joint_2d == MISSING).all(axis=(1, 2)),
            "pose_m is 0": (self.pose_m == 0).all(axis=1),
        }


def read_labels(
    frames: Frames, name: str, cache: Path | None, workers: int, files: FrameFiles | None = None
) -> DexYcbLabels:
    """The labels of frames, in their order.

    The cache's name depends on the frames and on each label's size and modification time, so that changed
    labels are read again.

    Args:
        frames: Frames to read.
        name: Name of the split, for the cache's name and messages.
        cache: Folder of caches; None reads every time.
        workers: Number of reading processes; 0 or 1 reads in this one.
        files: Digests of the frames' files, if they are known already.

    Raises:
        FileNotFoundError: A folder or file is missing.
        ValueError: A file is damaged.
    """
    if cache is None:
        return DexYcbLabels(**_read_all(frames, workers))
    files = files or digest_files(frames)
    target = cache / f"dexycb-{name}-labels-{files.labels}"

    def build(partial: Path) -> None:
        logger.info("Reading the labels of %d frames of DexYCB %s once", len(frames), name)
        for column, array in _read_all(frames, workers).items():
            np.save(partial / f"{column}.npy", array)

    ensure_built(target, build)
    return DexYcbLabels(
        **{column: np.load(target / f"{column}.npy", allow_pickle=False) for column in SHAPES}
    )


def labelled_rows(labels: DexYcbLabels, name: str) -> Int[np.ndarray, " row"]:
    """Rows of the frames with a labelled hand; the number of the others is logged.

    Args:
        labels: Labels of all frames.
        name: Name of the split, for messages.

    Raises:
        ValueError: No frame is left.
    """
    marks = labels.unlabelled()
    dropped = np.logical_or.reduce(list(marks.values()))
    counts = ", ".join(f"{mark}: {int(rows.sum())}" for mark, rows in marks.items())
    logger.info(
        "DexYCB %s: dropped %d of %d frames without a labelled hand (all of %s); %d are left.",
        name, int(dropped.sum()), len(labels), counts, int((~dropped).sum()),
    )  # fmt: skip
    scored = int((dropped & ~marks["joint_3d is −1"]).sum())
    if scored:
        logger.warning(
            "DexYCB %s: %d of the dropped frames have joint_3d, which the official evaluation scores, but no "
            "joint_2d or pose_m. A file of results has to have their ids too.", name, scored,
        )  # fmt: skip
    if dropped.all():
        raise ValueError(
            f"None of the {len(labels)} frames of DexYCB {name} shows a labelled hand ({counts}). Unpack the "
            "archives again."
        )
    return np.flatnonzero(~dropped)


def check_labels(
    labels: DexYcbLabels, intrinsics: Float[np.ndarray, "frame 3 3"], name: str
) -> None:
    """Refuse labels that are not the projections of hands in metres in front of a camera.

    Args:
        labels: Labels of labelled hands; about 20,000 of them are checked.
        intrinsics: Camera matrices, pixels.
        name: Name of the split, for messages.

    Raises:
        ValueError: Most are not.
    """
    rows = np.arange(0, len(labels), max(1, len(labels) // _LOOKED_AT))
    labels, intrinsics = labels.select(rows), intrinsics[rows]
    points = labels.joint_3d.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = project_array(points, intrinsics)
    missed = np.abs(pixels - labels.joint_2d).max(axis=(1, 2))
    wrong = ~(missed < _TOO_FAR) | (points[..., 2] <= 0).any(axis=1)
    if wrong.mean() > 0.5:
        raise ValueError(
            f"DexYCB {name}: in {int(wrong.sum())} of {len(labels)} frames joint_2d is not the projection of "
            f"joint_3d by calibration/intrinsics (median {np.median(missed):.1f} px off). Take labels and "
            "calibration from one release, at its size of 640 × 480."
        )
    palm = float(np.median(np.linalg.norm(points[:, 9] - points[:, 0], axis=-1)))
    if not 0.04 < palm < 0.2:
        raise ValueError(
            f"DexYCB {name}: wrist and middle MCP are {palm:.4g} apart in the median, expected about 0.09: "
            "joint_3d must be metres, in the order of its toolkit."
        )


def _read_all(frames: Frames, workers: int) -> dict[str, Float[np.ndarray, "frame ..."]]:
    arrays = {
        column: np.empty((len(frames), *shape), np.float32) for column, shape in SHAPES.items()
    }
    tasks = list(tasks_of(frames))
    done = 0
    for part in with_progress(_parts(tasks, workers), len(tasks), "Reading folders of labels"):
        count = len(part["pose_m"])
        for column, values in part.items():
            arrays[column][done : done + count] = values
        done += count
    return arrays


def _parts(tasks: list[Task], workers: int) -> Iterator[dict[str, np.ndarray]]:
    """Labels of the folders in order, read here or in processes; threads would wait for each other."""
    count = sum(len(numbers) for _, numbers in tasks)
    if workers <= 1 or count < WORTH_PROCESSES:
        yield from map(_read_folder, tasks)
        return
    with single_threaded_processes(workers) as pool:
        yield from pool.map(_read_folder, tasks, chunksize=4)


def _read_folder(task: Task) -> dict[str, np.ndarray]:
    folder, numbers = task
    labels = [_read_label(label_path(folder, number)) for number in numbers]
    return {column: np.stack([label[column] for label in labels]) for column in SHAPES}


def _read_label(path: Path) -> dict[str, np.ndarray]:
    """The three arrays of a label; the large segmentation array is not unpacked.

    Raises:
        FileNotFoundError: It is missing.
        ValueError: It is damaged, or something else.
    """
    try:
        # Read at once: a zip file is otherwise read in a dozen pieces, which is slow over a network.
        label = load_arrays(io.BytesIO(path.read_bytes()), path, SHAPES)
    except FileNotFoundError as error:
        raise FileNotFoundError(
            f"No {path}, although meta.yml counts it. Unpack the archive of its subject again."
        ) from error
    except (OSError, ValueError) as error:
        raise ValueError(
            f"{path} cannot be read as DexYCB's labels ({error}). Unpack the archive of its subject again."
        ) from error
    for column, shape in SHAPES.items():
        if label[column].shape != (1, *shape):
            raise ValueError(
                f"{path} has {column} of shape {list(label[column].shape)}, expected {[1, *shape]}: one hand."
            )
    return {column: values[0] for column, values in label.items()}
