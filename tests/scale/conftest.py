"""Fixture of tests that start Daft's worker processes."""

import gc
from collections.abc import Iterator

import pytest


@pytest.fixture
def processes() -> Iterator[None]:
    """Close the pipes of workers that have ended before the next test."""
    yield
    gc.collect()
