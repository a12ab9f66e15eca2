"""Hands rendered by processes of their own until a time is over, for training beside photographs."""

import time
from concurrent.futures import Future, wait
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from types import TracebackType
from typing import TYPE_CHECKING, Final

import numpy as np
import torch
from jaxtyping import Float, UInt8

from gpu.resident import ResidentHands

if TYPE_CHECKING:
    from hand_recon.data.synthetic.recipe import Recipe

CHUNK: Final = 8
"""Images of one piece of work."""

_GRACE: Final = 5.0
"""Longest time that pieces of work are waited for after the end, seconds."""

NEEDED: Final = ("cv2", "embreex")
"""Modules that rendering needs besides."""

Rendered = tuple[UInt8[np.ndarray, "image 3 size size"], Float[np.ndarray, "image landmark=21 2"]]


@dataclass(frozen=True)
class Order:
    """Number, size and kind of the images to render, and the time for them."""

    count: int
    """Most images."""
    seconds: float
    """Time limit."""
    processes: int
    """Number of processes."""
    size: int
    """Side of an image, pixels."""
    level: str = "any_pose"
    """A key of `hand_recon.data.synthetic.levels.DIFFICULTIES`."""
    landmark_set: str = "mediapipe"
    """Landmark set of the labels."""
    seed: int = 0
    """Seed of the set; image i is the same whatever the time limit is."""


class Renderer:
    """Renders in the background from its creation on; use it as a context.

    Without the modules that rendering needs, or with no image to render, it gives no hands, with a note.
    """

    def __init__(self, order: Order) -> None:
        """Start the processes."""
        self._stack = ExitStack()
        self._work: list[Future[Rendered | None]] = []
        self._end = time.time() + order.seconds
        missing = [name for name in NEEDED if find_spec(name) is None]
        if order.count and missing:
            print(f"No rendered hands: {' and '.join(missing)} cannot be imported.", flush=True)
        elif order.count:
            self._start(order)

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def hands(self, device: torch.device) -> ResidentHands | None:
        """All hands that were rendered in time, in the device's memory; None without any."""
        wait(self._work, max(0.0, self._end + _GRACE - time.time()))
        done = [one for one in self._work if one.done() and not one.cancelled()]
        failed = [one.exception() for one in done if one.exception() is not None]
        if failed:
            print(f"{len(failed)} pieces of rendering failed; the first: {failed[0]!r}", flush=True)
        pieces = [one.result() for one in done if one.exception() is None]
        found = [piece for piece in pieces if piece is not None]
        if not found:
            return None
        images = torch.cat([torch.from_numpy(image).to(device) for image, _ in found])
        labels = torch.from_numpy(np.concatenate([labels for _, labels in found])).to(device)
        names = tuple(f"rendered/{number}" for number in range(len(labels)))
        return ResidentHands(images, labels, labels.isfinite().all(dim=-1), names)

    def _start(self, order: Order) -> None:
        # These import OpenCV, which a machine without rendered hands does not need.
        from hand_recon.data.processes import single_threaded_processes
        from hand_recon.data.synthetic.recipe import Recipe, level_named

        recipe = Recipe(
            "train", level_named(order.level), order.size, order.seed, order.landmark_set
        )
        starts = range(0, order.count, CHUNK)
        pool = self._stack.enter_context(
            single_threaded_processes(min(order.processes, len(starts)))
        )
        self._work = [
            pool.submit(render, recipe, start, min(start + CHUNK, order.count), self._end)
            for start in starts
        ]


def render(recipe: "Recipe", start: int, stop: int, end: float) -> Rendered | None:
    """Render the images from `start` up to `stop`, as many as are begun before a time of the clock."""
    from hand_recon.data.synthetic.scene import synthetic_hand

    hands = []
    for index in range(start, stop):
        if time.time() >= end:
            break
        hands.append(synthetic_hand(recipe, index))
    if not hands:
        return None
    images = np.stack([hand.image.transpose(2, 0, 1) for hand in hands])
    return images, np.stack([hand.landmarks_2d for hand in hands]).astype(np.float32)
