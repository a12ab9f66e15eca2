"""Processor time per hand of reading from files, from the map of crops and from shards (docs/scaling.md).

PYTHONPATH=.:tools python tools/measure_shards.py --labels labels.json --images <folder> --folder <new folder>

One process with one thread; batches of 64 in a shuffled order. The server of the loopback rows is a process
of its own, whose time is not counted.
"""

import argparse
import multiprocessing
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import torch

from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.landmarks.datamodule import LandmarkDataModule
from hand_recon.data.shards.datamodule import ShardDataModule
from hand_recon.runs.shard_run import prepare_shards
from tests.support.configurations import settings
from tests.support.shard_server import serving

BATCH: Final = 64


def serve(folder: Path, pipe: Any) -> None:  # noqa: ANN401  # a connection
    """Serve a folder until the parent closes the pipe."""
    with serving(folder) as served:
        pipe.send(served.url)
        pipe.recv()


def rate(data: HandDataModule, most: int) -> tuple[float, float]:
    """Processor time and time per hand over part of an epoch, milliseconds."""
    batches = iter(data.train_dataloader())
    next(batches)
    hands, start, start_cpu = 0, time.perf_counter(), time.process_time()
    for batch in batches:
        hands += len(batch)
        if hands >= most:
            break
    return (
        1e3 * (time.process_time() - start_cpu) / hands,
        1e3 * (time.perf_counter() - start) / hands,
    )


def sources(
    folder: Path, labels: Path, images: Path, url: str, size: int
) -> dict[str, Callable[[], HandDataModule]]:
    """Datamodules by name."""
    cached, web = ReadingPolicy(folder / "cache"), ReadingPolicy(folder / f"web{size}")
    common: dict[str, Any] = {
        "crop": CropPolicy(size, "joints"), "batch_size": BATCH, "val_fraction": 0.01,
    }  # fmt: skip
    return {
        "image files": lambda: LandmarkDataModule(labels, images=images, **common),
        "map of crops": lambda: LandmarkDataModule(labels, images=images, reading=cached, **common),
        "shards": lambda: ShardDataModule(train=folder / "shards", **common),
        "shards, order=shards": lambda: ShardDataModule(
            train=folder / "shards", order="shards", **common
        ),
        "shards over http, ranges": lambda: ShardDataModule(train=url, reading=web, **common),
        "shards over http, order=shards": lambda: ShardDataModule(
            train=url, reading=web, order="shards", **common
        ),
        "smaller shards": lambda: ShardDataModule(train=folder / "small", **common),
    }


def main() -> None:
    """Make the shards, measure, print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("--labels", "--images", "--folder"):
        parser.add_argument(name, type=Path, required=True)
    parser.add_argument("--most", type=int, default=1000, help="hands of each measurement")
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(0)
    for name, further in (("shards", ()), ("small", ("max_side=256",))):
        output = asked.folder / name
        if output.exists():
            continue
        start = time.process_time()
        told = prepare_shards(
            settings(output, output, f"labels='{asked.labels}'", f"images='{asked.images}'",
                     f"output='{output}'", "images_per_shard=300", *further, name="prepare_shards")
        )  # fmt: skip
        spent = 1e3 * (time.process_time() - start) / told["images"]
        print(f"prepare shards ({name}): {spent:.2f} ms of processor time per image")
    ours, theirs = multiprocessing.get_context("spawn").Pipe()
    server = multiprocessing.get_context("spawn").Process(
        target=serve, args=(asked.folder / "shards", theirs)
    )
    server.start()
    url = ours.recv()
    for size in (136, 224):
        for name, make in sources(asked.folder, asked.labels, asked.images, url, size).items():
            found = np.array([rate(make(), asked.most) for _ in range(asked.rounds)])
            cpu, wall = np.median(found, axis=0)
            print(f"| {size} | {name} | {cpu:.2f} | {1e3 / cpu:.0f} | {wall:.2f} |", flush=True)
    ours.send(None)
    server.join()


if __name__ == "__main__":
    main()
