"""Mutated files of every kind end in a clear error or a result; `make fuzz` does this a million times."""

import random
from pathlib import Path
from types import SimpleNamespace
from typing import Final

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzz_readers import Row, fuzz, mutated
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from tests.support.fuzzed import PARSERS, Parser, outcome_of

CHEAP: Final = (
    "JSON",
    "YAML",
    "npy",
    "npz",
    "pickle",
    "headers of images",
    "limits",
    "tracker's state",
)
"""Parsers of bytes in memory."""


def kept(content: bytes) -> Path:
    """Names a finding; the message of the test has its bytes."""
    return Path(repr(content[:2000]))


@pytest.mark.parametrize("name", PARSERS)
def test_mutated_files_end_in_a_clear_error_or_a_result(name: str) -> None:
    row = fuzz(PARSERS[name], 2.0, 40, 7, kept)
    assert not row.findings, "\n".join(row.findings)
    assert row.refused + row.accepted == row.executions > 0


@pytest.mark.parametrize("name", CHEAP)
@given(content=st.binary(max_size=200))
@settings(max_examples=30)
def test_any_bytes_end_in_a_clear_error_or_a_result(name: str, content: bytes) -> None:
    assert not outcome_of(PARSERS[name], content).finding


def _careless(content: bytes) -> object:
    if content.startswith(b"ab"):
        return [][0]
    raise ValueError("input: refused")


def test_the_fuzzer_finds_what_a_careless_parser_raises_and_an_error_without_the_files_name() -> (
    None
):
    row = fuzz(Parser("careless", _careless, lambda: [b"abc", b"x"]), 5.0, 50, 0, kept)
    assert isinstance(row, Row)
    assert ["IndexError" in finding for finding in row.findings] == [True]
    assert row.refused > 0

    def unnamed(content: bytes) -> object:
        raise ValueError("refused")

    found = fuzz(Parser("unnamed", unnamed, lambda: [b"a"]), 5.0, 5, 0, kept).findings
    assert len(found) == 1
    assert "unnamed: refused" in found[0]


def test_the_fuzzer_finds_labels_and_hangs_of_inputs_that_are_read_like_earlier_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = [0.0]
    monkeypatch.setattr("fuzz_readers.time", SimpleNamespace(monotonic=lambda: clock[0]))
    good = PARSERS["landmarks"].seeds()[0]

    def parse(content: bytes) -> object:
        found = PARSERS["landmarks"].parse(good)
        assert isinstance(found, ImageLandmarks)
        if content == b"slow":
            clock[0] += 6
        if content in (b"infinite", b"zero"):
            found.landmarks_2d[0, 0] = torch.inf if content == b"infinite" else 0.0
        return found

    # The last input is read first, and all of them end in the same way.
    inputs = [b"slow", b"slow", b"zero", b"zero", b"infinite", b"infinite", b"fine"]
    row = fuzz(Parser("late", parse, lambda: inputs), 99.0, len(inputs), 0, kept)
    told = [finding.partition(" [")[0] for finding in row.findings]
    assert told == ["an infinite label", "a label of zero", "it took 6 s"]
    assert row.accepted == len(inputs)


REGRESSIONS: Final = {
    "npy": b"\x93NUMPY\x01\x00\x10\x00{'descr': (((((\n",
    "landmarks, npy": (
        b"\x93NUMPY\x01\x00\x40\x00{'descr': ',f8', 'fortran_order': False, 'shape': (3, 21, 2)"
        b", }\n"
    ),
    "shards, index": b"\x93NUMPY\x01\x00\x10\x00{'descr': (((((\n",
    "shards, manifest": b'{"format": "hand_recon.shards/1", "groups": 1e400}',
    "shards, labels": b'{"image": "a", "hands": [{"side": "left", "landmarks": [[Infinity, 1.5]]}]}',
    "shards, facts": b"image,person\na.jpg," + 140_000 * b"x",
    "camera, YAML": b"[" * 100_000 + b"]" * 100_000,
    "DexYCB": b"color: null\n",
    "audit, table": b"x0,y0,z0,x1,y1,z1\n1,2\n",
    "predictions, zip": b"PK\x05\x06" + bytes(8) + b"\xff" * 8 + bytes(2),
    "camera, XML": b"<?xml version='1.0'?><opencv_storage>"
    + b"<a>" * 100_000
    + b"</a>" * 100_000
    + b"</opencv_storage>",
}
"""Inputs that ended with a traceback, or ended the process, before."""


@pytest.mark.parametrize("name", REGRESSIONS)
def test_what_was_found_once_is_refused(name: str) -> None:
    outcome = outcome_of(PARSERS[name], REGRESSIONS[name])
    assert not outcome.finding
    assert not outcome.accepted


def test_mutations_depend_on_the_seed_alone() -> None:
    made = [mutated(b"abcdef" * 9, [b"xyz"], random.Random(4)) for _ in range(2)]  # noqa: S311
    assert made[0] == made[1]
