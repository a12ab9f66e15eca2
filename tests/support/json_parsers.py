"""Tests of JSON readers run with each of the two parsers of numbers."""

import pytest

from hand_recon.data import json_arrays


@pytest.fixture(params=["simdjson", "numpy"])
def parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read with pysimdjson, and as if it were not installed."""
    if request.param == "numpy":
        monkeypatch.setattr(json_arrays, "SIMDJSON", None)
    elif json_arrays.SIMDJSON is None:
        pytest.skip("pysimdjson is not installed")
