"""Train rows of Table 1 on packed hands within a time limit, on one GPU or on a processor.

    PYTHONPATH=.:tools python -m gpu.train carried --out trained --minutes 9

`carried` is the folder that `gpu.pack` wrote. It ends in time with what it has: `trained/report.json` and
the weights of each finished row.
"""

import argparse
import os
import threading
import time
from pathlib import Path
from typing import Final

OVERDUE: Final = 3
"""Exit status of a process that was ended by force."""

_GRACE: Final = 10.0
"""Seconds after the limit at which this happens."""


def parser() -> argparse.ArgumentParser:
    """Options of the script."""
    options = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    add = options.add_argument
    add("folder", type=Path, help="folder of gpu.pack: hands.npz and backbone.pth")
    add("--out", type=Path, required=True, help="folder of report.json and the weights")
    add("--minutes", type=float, default=9.0, help="limit of everything, from the start on")
    add("--seconds", type=float, help="limit of a row; by default an equal share of the time")
    add("--steps", type=int, help="steps of a row, for tests; the time limits hold all the same")
    add("--rows", type=_rows, default=(1, 4, 5), help="rows of Table 1, such as 1,4,5")
    add("--backbone", default="efficientnet_lite0", help="or resnet50, and others of torchvision")
    add("--weights", help="imagenet, none, or a state dict; by default backbone.pth, else none")
    add(
        "--crop",
        type=int,
        default=272,
        help="side of a crop; the network sees the middle 224 of 272",
    )
    add("--batch", type=int, default=256, help="hands per step")
    add("--learning-rate", type=float, default=1e-3, help="highest learning rate")
    add("--precision", choices=("bf16", "fp32"), default="bf16", help="of the convolutions")
    add("--compile", action="store_true", help="compile the backbone")
    add("--rendered", type=int, default=20_000, help="most rendered hands; 0 for none")
    add("--rendered-share", type=float, default=0.15, help="share of them in a batch")
    add("--render-seconds", type=float, default=60.0, help="time for rendering, before the rows")
    add("--level", default="any_pose", help="level of rendered hands")
    add("--processes", type=int, help="rendering processes; by default one core is left")
    add("--reserve", type=float, default=20.0, help="seconds for scores and files of a row")
    add("--saved-rows", type=_rows, help="rows whose weights are written; by default all")
    add("--largest", type=float, default=15.0, help="largest file of weights, MiB")
    add("--every", type=float, default=5.0, help="seconds between two lines of progress")
    add("--seed", type=int, default=0, help="seed of weights, order and augmentation")
    add("--device", help="such as cuda or cpu; by default a GPU if there is one")
    return options


def _rows(text: str) -> tuple[int, ...]:
    return tuple(int(word) for word in text.split(","))


def main(words: list[str] | None = None) -> int:
    """Train; the exit status is 1 if a row failed or was left out."""
    began = time.monotonic()
    options = parser().parse_args(words)
    # Not above: every rendering process imports this module first, and needs nothing of it.
    from gpu.session import run

    return run(options, began)


def script(words: list[str] | None = None) -> int:
    """Train, but end the process by force if it lasts longer than it may.

    A step is not interrupted otherwise, and one that compiles the network, or a GPU that hangs, takes long.
    """
    limit = 60 * parser().parse_args(words).minutes + _GRACE
    timer = threading.Timer(max(0.0, limit), _end_by_force)
    timer.daemon = True
    timer.start()
    try:
        return main(words)
    finally:
        timer.cancel()


def _end_by_force() -> None:
    print("Ended by force, since the time is over; the files have what was finished.", flush=True)
    os._exit(OVERDUE)


if __name__ == "__main__":
    raise SystemExit(script())
