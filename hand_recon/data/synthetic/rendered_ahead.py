"""Synthetic hands that are rendered while others are read, in the order in which a training needs them.

An image depends on its recipe and index alone: whoever reads gets the same images in the same order as from a
complete store, and waits only for those that are not rendered yet.
"""

import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console

from hand_recon.data.cache import exclusive_lock
from hand_recon.data.processes import single_threaded_processes
from hand_recon.data.synthetic.image_store import (
    COLUMNS,
    Chunk,
    GrowingStore,
    render_chunk,
    store_path,
)
from hand_recon.data.synthetic.recipe import Recipe

_ONE_AT_A_TIME: Final = threading.Lock()
"""Held by the set that is being rendered: others of this process wait, in place of sharing the cores."""

_ALIVE: Final = 1.0
"""Seconds after which a waiting reader looks whether the rendering goes on."""


def render_ahead(
    cache_dir: Path, recipe: Recipe, order: Sequence[int], workers: int
) -> "RenderedAhead | None":
    """Begin to render a set of images in the background; None if the cache has it already.

    If another process renders the same set, this waits until it is complete.

    Args:
        cache_dir: Folder of all stores; created if missing.
        recipe: Recipe of the set, with images.
        order: All indices of the set, those that are needed first before others.
        workers: Number of processes, at least 1.
    """
    path = store_path(cache_dir, recipe, len(order))
    if path.is_dir():
        return None
    cache_dir.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        stack.enter_context(exclusive_lock(path.with_suffix(".lock")))
        if path.is_dir():
            return None
        store = GrowingStore(path, recipe, len(order))
        return RenderedAhead(store, order, workers, stack.pop_all())


class RenderedAhead:
    """A set that a thread of this process renders with other processes."""

    def __init__(
        self, store: GrowingStore, order: Sequence[int], workers: int, lock: ExitStack
    ) -> None:
        """Begin to render.

        Args:
            store: The incomplete store.
            order: All indices, those that are needed first before others.
            workers: Number of processes.
            lock: Holds the store's lock, which is freed when nothing is rendered any more.
        """
        self._store = store
        self._changed = threading.Condition()
        self._ready = np.zeros(store.size, dtype=bool)
        self._labels: dict[str, np.ndarray] = {}
        self._failure: BaseException | None = None
        self._complete = False
        self._process = os.getpid()
        store.begin()
        self._images = np.load(store.folder / "images.npy", mmap_mode="r")
        self._add(store.rendered())
        self._thread = threading.Thread(
            target=self._render, args=(store.missing(order), workers, lock), daemon=True
        )
        self._thread.start()

    @property
    def path(self) -> Path:
        """Folder of the store once it is complete."""
        return self._store.path

    @property
    def complete(self) -> bool:
        """True if images are read from the store alone: once it is complete, and in forked processes."""
        return self._complete or os.getpid() != self._process

    def read(self, indices: Sequence[int]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Images and labels of some indices, once they are rendered.

        Raises:
            RuntimeError: The rendering ended before.
        """
        index = np.asarray(indices)
        self._wait(lambda: self._complete or bool(self._ready[index].all()))
        return self._images[index], {name: self._labels[name][index] for name in COLUMNS}

    def wait(self) -> None:
        """Wait until the store is complete.

        Raises:
            RuntimeError: The rendering ended before.
        """
        if os.getpid() == self._process:
            self._wait(lambda: self._complete)
            return
        # A forked process has a copy of this object, but not the thread, which holds the lock to its end.
        with exclusive_lock(self.path.with_suffix(".lock")):
            if not self.path.is_dir():
                raise RuntimeError(
                    f"Rendering of {self.path.name} ended early in the process that began it, whose message "
                    "says why. The same command goes on with the missing images."
                )

    def _wait(self, reached: Callable[[], bool]) -> None:
        with self._changed:
            while not reached():
                if self._failure is not None or not self._thread.is_alive():
                    raise RuntimeError(
                        f"Rendering of {self._store.path.name} ended after {self._ready.sum()} of "
                        f"{self._store.size} images ({self._failure!r}); the same command goes on with the "
                        "missing ones, and data.render_workers=1 renders them in one process."
                    ) from self._failure
                self._changed.wait(_ALIVE)

    def _add(self, labels: dict[str, np.ndarray]) -> None:
        """Take over the labels of rendered images."""
        index = labels["index"]
        if not len(index):
            return
        with self._changed:
            for name in COLUMNS:
                values = labels[name]
                if name not in self._labels:
                    shape = (self._store.size, *values.shape[1:])
                    self._labels[name] = np.zeros(shape, dtype=values.dtype)
                self._labels[name][index] = values
            self._ready[index] = True
            self._changed.notify_all()

    def _render(self, chunks: list[Chunk], workers: int, lock: ExitStack) -> None:
        with lock:
            try:
                with _ONE_AT_A_TIME:
                    self._render_all(chunks, workers)
            # Whoever waits raises it.
            except BaseException as error:  # noqa: BLE001
                self._failure = error
            with self._changed:
                self._complete = self._failure is None
                self._changed.notify_all()

    def _render_all(self, chunks: list[Chunk], workers: int) -> None:
        store, level = self._store, self._store.recipe.level.name
        rendered, began = sum(len(chunk.indices) for chunk in chunks), time.perf_counter()
        Console(stderr=True).print(
            f"Rendering {rendered} {level} {store.recipe.split} hands meanwhile (once; kept in the cache) …"
        )
        with single_threaded_processes(workers) as pool:
            waiting: set[Future[dict[str, np.ndarray]]] = set()
            for chunk in chunks:
                # Few are submitted at a time, since Python ends only after all that are.
                while len(waiting) > workers:
                    waiting = self._collect(waiting)
                waiting.add(pool.submit(render_chunk, chunk))
            while waiting:
                waiting = self._collect(waiting)
        seconds = time.perf_counter() - began
        store.finish({"rendered": rendered, "seconds": seconds, "workers": workers})

    def _collect(
        self, waiting: set[Future[dict[str, np.ndarray]]]
    ) -> set[Future[dict[str, np.ndarray]]]:
        """Take over the next chunks that are complete; returns the others."""
        done, others = wait(waiting, return_when=FIRST_COMPLETED)
        # Chunks that are complete are taken over before the error of another one is raised.
        for future in sorted(done, key=lambda one: one.exception() is not None):
            self._add(future.result())
        return others
