"""Cache of rendered synthetic hands: rendered once, in parallel, and resumed after an interruption.

A store is a folder with `images.npy` (bytes, memory-mapped), `labels.npz` (all labels) and `manifest.json`.
It is built under another name and renamed when complete, so a folder with the final name is complete.
"""

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
from numpy.lib.format import open_memmap
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from hand_recon.data.cache import exclusive_lock
from hand_recon.data.processes import single_threaded_processes
from hand_recon.data.synthetic.recipe import Recipe
from hand_recon.data.synthetic.scene import SyntheticView, synthetic_hand, synthetic_view
from hand_recon.hand.open_hand import ASSET

CHUNK: Final = 64
"""Images per unit of work; an interruption loses at most this many per worker."""

COLUMNS: Final[tuple[str, ...]] = (
    "landmarks_2d", "labelled", "label_noise", "confidence", "occluded", "landmarks_3d", "intrinsics",
    "joint_angles", "shape", "root_rotation", "translation",
)  # fmt: skip
"""Stored labels of each image; names as in `SyntheticView`."""

_NOT_HASHED: Final = frozenset(
    {"datamodule.py", "dataset.py", "image_store.py", "rendered_ahead.py"}
)
"""Modules of this package that images do not depend on."""

_HASHED_ELSEWHERE: Final = (
    "camera.py", "rendering/rays.py", "hand/model.py", "hand/anatomical_frame.py", "hand/kinematics.py",
    "hand/skinning.py", f"hand/{ASSET}",
)  # fmt: skip
"""Files of other packages that images depend on."""


@dataclass(frozen=True)
class Chunk:
    """Images that one process renders at once."""

    recipe: Recipe
    """Recipe of the whole set."""
    folder: Path
    """Folder of the incomplete store."""
    indices: tuple[int, ...]
    """Indices of the images."""

    @property
    def path(self) -> Path:
        """File with the chunk's labels, which exists once the chunk is complete."""
        return self.folder / f"chunk_{self.indices[0]:08d}.npz"


@dataclass(frozen=True)
class GrowingStore:
    """A store that is not complete yet; no image is in two of its chunks."""

    path: Path
    """Folder of the store once it is complete."""
    recipe: Recipe
    """Recipe of the set."""
    size: int
    """Number of images."""

    @property
    def folder(self) -> Path:
        """Folder of the incomplete store."""
        return self.path.with_name(self.path.name + ".partial")

    def begin(self) -> None:
        """Make the folder and the file of images, unless an interrupted command has made them."""
        self.folder.mkdir(exist_ok=True)
        images = self.folder / "images.npy"
        if self.recipe.pictures and not images.is_file():
            shape = (self.size, 3, self.recipe.crop_size, self.recipe.crop_size)
            open_memmap(images.with_suffix(".new"), "w+", np.uint8, shape).flush()
            images.with_suffix(".new").rename(images)

    def rendered(self) -> dict[str, np.ndarray]:
        """Labels of all complete chunks, with the images' indices as `index`."""
        pieces = [_empty()]
        for path in sorted(self.folder.glob("chunk_*.npz")):
            with np.load(path) as archive:
                # Chunks of an earlier version have no indices; they are rendered again.
                if "index" in archive:
                    pieces.append({name: archive[name] for name in ("index", *COLUMNS)})
        return {
            name: np.concatenate([piece[name] for piece in pieces[len(pieces) > 1 :]])
            for name in pieces[0]
        }

    def missing(self, order: Sequence[int]) -> list[Chunk]:
        """Chunks that are left to render, in the order of their images."""
        done = set(self.rendered()["index"].tolist())
        left = [index for index in order if index not in done]
        return [
            Chunk(self.recipe, self.folder, tuple(left[start : start + CHUNK]))
            for start in range(0, len(left), CHUNK)
        ]

    def finish(self, work: dict[str, float]) -> None:
        """Join the chunks' labels, write the manifest, remove temporary files and rename the folder."""
        found = self.rendered()
        place = np.argsort(found["index"])
        with (self.folder / "labels.npz").open("wb") as stream:
            _save(stream, {name: found[name][place] for name in COLUMNS})
        rate = work["rendered"] / max(work["seconds"], 1e-9)
        manifest = {
            "recipe": asdict(self.recipe),
            "size": self.size,
            "fingerprint": fingerprint(self.recipe, self.size),
            "images_per_second": round(rate, 1),
            **work,
            "versions": {
                name: version(name) for name in ("numpy", "embreex", "opencv-python-headless")
            },
        }
        text = json.dumps(manifest, indent=2)
        (self.folder / "manifest.json").write_text(text, encoding="utf-8")
        for leftover in self.folder.glob("chunk_*"):
            leftover.unlink()
        if work["rendered"]:
            Console(stderr=True).print(
                f"Rendered {work['rendered']} hands in {work['seconds']:.0f} s ({rate:.0f} images/s)."
            )
        self.folder.rename(self.path)


def fingerprint(recipe: Recipe, size: int) -> str:
    """Hash of the recipe, the renderer's source, the gestures and the hand, ten hexadecimal digits."""
    digest = hashlib.sha256(json.dumps([asdict(recipe), size], sort_keys=True).encode())
    own = files("hand_recon.data.synthetic")
    names = sorted(entry.name for entry in own.iterdir())
    for name in names:
        if name.endswith((".py", ".yaml")) and name not in _NOT_HASHED:
            digest.update((own / name).read_bytes())
    for name in _HASHED_ELSEWHERE:
        digest.update((files("hand_recon") / name).read_bytes())
    return digest.hexdigest()[:10]


def store_path(cache_dir: Path, recipe: Recipe, size: int) -> Path:
    """Folder of a recipe's store."""
    resolution = f"x{recipe.crop_size}px" if recipe.pictures else "_views"
    name = f"synthetic_{recipe.level.name}_{recipe.split}_{size}{resolution}"
    return cache_dir / f"{name}_{fingerprint(recipe, size)}"


def ensure_store(cache_dir: Path, recipe: Recipe, size: int, workers: int) -> Path:
    """Return the folder of a store, and render it first if it does not exist.

    Args:
        cache_dir: Folder for this and other stores; created if missing.
        recipe: Recipe of the set.
        size: Number of images.
        workers: Number of processes; 0 or 1 renders in this process.

    Raises:
        ValueError: The size is not positive.
    """
    if size < 1:
        raise ValueError(f"A synthetic set needs at least one image, found size={size}.")
    path = store_path(cache_dir, recipe, size)
    if path.is_dir():
        return path
    cache_dir.mkdir(parents=True, exist_ok=True)
    with exclusive_lock(path.with_suffix(".lock")):
        # Another process may have finished the same set while this one waited for the lock.
        if not path.is_dir():
            _build(GrowingStore(path, recipe, size), workers)
    return path


def _build(store: GrowingStore, workers: int) -> None:
    """Render the missing chunks, then finish the store."""
    store.begin()
    recipe, size = store.recipe, store.size
    missing = store.missing(range(size))
    rendered = sum(len(chunk.indices) for chunk in missing)
    began = time.perf_counter()
    noun = "hands" if recipe.pictures else "views"
    with _progress(f"{size} {recipe.level.name} {recipe.split} {noun}", size) as advance:
        advance(size - rendered)
        _render_all(missing, workers, advance)
    seconds = time.perf_counter() - began
    store.finish({"rendered": rendered, "seconds": seconds, "workers": max(workers, 1)})


def _render_all(chunks: list[Chunk], workers: int, advance: Callable[[int], None]) -> None:
    """Render all chunks, in this process or in several new ones."""
    if workers <= 1:
        for chunk in chunks:
            advance(len(render_chunk(chunk)["index"]))
        return
    with single_threaded_processes(min(workers, max(len(chunks), 1))) as pool:
        waiting = {pool.submit(render_chunk, chunk) for chunk in chunks}
        while waiting:
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                advance(len(future.result()["index"]))


def render_chunk(chunk: Chunk) -> dict[str, np.ndarray]:
    """Render a chunk into the store and return its labels, with the images' indices as `index`."""
    hands: list[SyntheticView] = []
    if chunk.recipe.pictures:
        images = np.load(chunk.folder / "images.npy", mmap_mode="r+")
        for index in chunk.indices:
            hand = synthetic_hand(chunk.recipe, index)
            images[index] = hand.image.transpose(2, 0, 1)
            hands.append(hand)
        images.flush()
    else:
        hands += [synthetic_view(chunk.recipe, index) for index in chunk.indices]
    labels = {"index": np.array(chunk.indices)} | {name: _column(hands, name) for name in COLUMNS}
    unfinished = chunk.path.with_suffix(f".{os.getpid()}")
    with unfinished.open("wb") as stream:
        _save(stream, labels)
    unfinished.rename(chunk.path)
    return labels


def _empty() -> dict[str, np.ndarray]:
    return {"index": np.zeros(0, dtype=int)} | {name: np.zeros(0) for name in COLUMNS}


def _save(stream: BinaryIO, columns: dict[str, np.ndarray]) -> None:
    np.savez(stream, allow_pickle=False, **columns)


def _column(hands: list[SyntheticView], name: str) -> np.ndarray:
    values = np.stack([getattr(hand, name) for hand in hands])
    return values if values.dtype == bool else values.astype(np.float32)


@contextmanager
def _progress(title: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show a progress bar on a terminal, or print a line after every tenth."""
    console = Console(stderr=True)
    if console.is_terminal:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        with Progress(*columns, TimeRemainingColumn(), console=console) as bar:
            task = bar.add_task(f"Rendering {title}", total=total)
            yield lambda count: bar.advance(task, count)
        return
    done, began = 0, time.perf_counter()
    console.print(f"Rendering {title} (once; kept in the cache) …")

    def advance(count: int) -> None:
        nonlocal done
        before, done = done, done + count
        if done * 10 // total > before * 10 // total:
            seconds = time.perf_counter() - began
            console.print(f"  {done}/{total} after {seconds:.0f} s")

    yield advance
