"""Pool of single-threaded processes, for rendering hands and reading labels."""

import multiprocessing
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Final

import cv2
import torch

_THREAD_COUNTS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def single_threaded_processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """Pool of new processes of one thread each; on an error, pending work is cancelled.

    More threads per process would compete for the same cores.

    Args:
        count: Number of processes.
    """
    context = multiprocessing.get_context("spawn")
    with (
        _single_threaded_children(),
        ProcessPoolExecutor(count, mp_context=context, initializer=_one_thread) as pool,
    ):
        try:
            yield pool
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


@contextmanager
def _single_threaded_children() -> Iterator[None]:
    """Set the thread counts that numerical libraries read from the environment when first loaded to 1."""
    before = {name: os.environ.get(name) for name in _THREAD_COUNTS}
    os.environ.update(dict.fromkeys(_THREAD_COUNTS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def end_with_parent() -> None:
    """End this process with the one that started it, which a kill may end.

    Otherwise it would stay for ever, and write into the folder of the command that goes on.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def end() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def _one_thread() -> None:
    end_with_parent()
    torch.set_num_threads(1)
    cv2.setNumThreads(0)
