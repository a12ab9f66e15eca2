"""Runs the suites of the benchmark and writes their results (docs/performance.md)."""

import importlib
import logging
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import torch
from omegaconf import DictConfig
from rich.console import Console
from rich.table import Table

from hand_recon.runs.configuration import configure_process
from hand_recon.runs.unfinished import free_folder
from hand_recon.speed.benchmark_files import (
    FILES,
    HEADINGS,
    Benchmark,
    cells,
    read_benchmark,
    write_benchmark,
)
from hand_recon.speed.machine import describe
from hand_recon.speed.measurement import Settings
from hand_recon.speed.rows import LeftOut, Row
from hand_recon.speed.suites import SUITES

logger = logging.getLogger(__name__)


def benchmark(config: DictConfig) -> Benchmark:
    """Measure the suites that were asked for.

    Args:
        config: `conf/benchmark.yaml` composed.

    Raises:
        FileExistsError: The folder already holds a benchmark.
        ValueError: A suite or the device is unknown.
    """
    names = wanted_suites(config.suite)
    settings = Settings(
        threads=int(config.threads),
        device=known_device(config.device),
        seconds=float(config.seconds),
        quick=bool(config.quick),
        cache=str(config.paths.cache),
        checkpoint=config.ckpt,
    )
    baseline = (
        None if config.baseline is None else read_benchmark(Path(config.baseline).expanduser())
    )
    folder = free_folder(config.output or config.paths.run, FILES)
    configure_process(settings.threads)
    found = Benchmark(describe(), asdict(settings))
    for name in names:
        logger.info("Suite %s", name)
        for one in _measured(name, settings):
            if isinstance(one, Row):
                found.rows.append(one)
            else:
                found.left_out.append(one)
                logger.warning("%s, %s is left out: %s.", one.suite, one.work, one.reason)
        show(found, name)
    folder.mkdir(parents=True, exist_ok=True)
    write_benchmark(folder, found, baseline)
    logger.info("Open %s", folder / FILES[1])
    return found


def _measured(name: str, settings: Settings) -> Iterator[Row | LeftOut]:
    measured: Iterator[Row | LeftOut] = importlib.import_module(
        f"hand_recon.speed.suites.{name}"
    ).measure(settings)
    return measured


def wanted_suites(given: object) -> list[str]:
    """Names of suites, in the order of `SUITES`.

    Args:
        given: A name, names with commas, a list of names, or `all`.

    Raises:
        ValueError: A name is unknown.
    """
    words = str(given).split(",") if isinstance(given, str) else [str(one) for one in given]  # type: ignore[attr-defined]
    words = [word.strip() for word in words]
    unknown = [word for word in words if word not in (*SUITES, "all")]
    if unknown or not words:
        raise ValueError(
            f"Found suite={','.join(words)}; expected all, or one or more of {', '.join(SUITES)}."
        )
    return [name for name in SUITES if name in words or "all" in words]


def known_device(name: str) -> str:
    """Name of a device that this machine has.

    Args:
        name: Device of torch, such as `cpu` or `cuda`.

    Raises:
        ValueError: The machine has no such device.
    """
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise ValueError(
            f"Found device={name}, which this machine does not have ({str(error).splitlines()[0]}). "
            "Use device=cpu."
        ) from error
    return name


def show(found: Benchmark, suite: str) -> None:
    """Print the table of one suite."""
    rows = cells(found, suite)
    kept = [place for place in range(len(HEADINGS)) if any(row[place] for row in rows)]
    table = Table(title=suite, title_justify="left", box=None)
    for place in kept:
        table.add_column(HEADINGS[place], overflow="fold")
    for row in rows:
        table.add_row(*(row[place] for place in kept))
    Console().print(table)
