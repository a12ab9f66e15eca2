"""Tests that start worker processes of Daft."""

from collections.abc import Callable
from typing import Any, TypeVar

import pytest

Test = TypeVar("Test", bound=Callable[..., Any])

UNCLOSED = (
    "ignore:Exception ignored (in.|while finalizing file) <_io.FileIO"
    ":pytest.PytestUnraisableExceptionWarning"
)
"""Daft 0.7 leaves the pipe of a worker that has ended to the collection of unreachable objects."""


def in_processes(test: Test) -> Test:
    """Excuse a test from the pipes of ended workers, which `processes` closes before the next test."""
    marked: Test = pytest.mark.usefixtures("processes")(test)
    return pytest.mark.filterwarnings(UNCLOSED)(marked)
