"""A small lifter as an ONNX file, once for all tests: the translation takes seconds."""

import pytest

from tests.support.onnx_sessions import LifterFile, small_lifter_file


@pytest.fixture(scope="session")
def lifter_file() -> LifterFile:
    """A lifter of one round with random weights, and inputs as the packaged one has them."""
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package, reason="needs the extra onnx")
    return small_lifter_file()
