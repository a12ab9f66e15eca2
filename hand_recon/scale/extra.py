"""Packages of the extra `scale`, imported when they are needed."""

import importlib
import os
from types import ModuleType
from typing import Final

_CURE: Final = "Install the extra: pip install 'hand_recon[scale]'."


def daft_module() -> ModuleType:
    """Import Daft, without its messages to its makers about who uses it, and without its progress bars.

    Raises:
        ModuleNotFoundError: It is not installed.
    """
    os.environ.setdefault("DAFT_ANALYTICS_ENABLED", "0")
    os.environ.setdefault("DAFT_PROGRESS_BAR", "0")
    return _imported("daft", "Columns of images need")


def arrow_module() -> ModuleType:
    """Import PyArrow, which Daft's results are.

    Raises:
        ModuleNotFoundError: It is not installed.
    """
    return _imported("pyarrow", "Tables of hands need")


def parquet_module() -> ModuleType:
    """Import PyArrow's reader and writer of Parquet.

    Raises:
        ModuleNotFoundError: It is not installed.
    """
    return _imported("pyarrow.parquet", "Parquet files need")


def check_ray() -> None:
    """Import Ray, without its messages to its makers about who uses it.

    Raises:
        ModuleNotFoundError: It is not installed.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    _imported("ray", "ray=<address> needs", "Install it: pip install 'hand_recon[scale,ray]'.")


def _imported(name: str, need: str, cure: str = _CURE) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != name.partition(".")[0]:
            raise
        package = name.partition(".")[0]
        raise ModuleNotFoundError(f"{need} {package}, which is not installed. {cure}") from error
