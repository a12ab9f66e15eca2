"""LiteRT behind a function: loaded late, silent when it works, outputs that stay as they are."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from hand_recon.detection.interpreter import Network, _without_notes
from hand_recon.detection.models import LANDMARKS, PALMS, Model


def never() -> bytes:
    raise AssertionError("the model was read")


def crop(size: int, level: int) -> np.ndarray:
    return np.full((size, size, 3), level, dtype=np.uint8)


def test_nothing_is_read_before_the_first_image() -> None:
    pytest.importorskip("ai_edge_litert", reason="LiteRT (the extra detect) is not installed")
    network = Network(never)
    with pytest.raises(AssertionError, match="the model was read"):
        network(crop(192, 0))


def test_without_litert_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ai_edge_litert", None)
    monkeypatch.setitem(sys.modules, "ai_edge_litert.interpreter", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'hand_recon\[detect\]'.*landmarks"):
        Network(never)(crop(192, 0))


@pytest.mark.parametrize(
    ("model", "size", "shapes"),
    [
        (PALMS, 192, [(2016, 18), (2016, 1)]),
        (LANDMARKS, 224, [(63,), (1,), (1,), (63,)]),
    ],
)
def test_the_published_networks_have_the_inputs_and_outputs_that_are_decoded(
    models: Path, model: Model, size: int, shapes: list[tuple[int, ...]]
) -> None:
    network = Network((models / model.file).read_bytes)
    assert network.input_size == size
    assert [output.shape for output in network(crop(size, 90))] == shapes


def test_outputs_are_not_overwritten_by_the_next_image(models: Path) -> None:
    network = Network((models / LANDMARKS.file).read_bytes)
    first = network(crop(224, 10))
    kept = [output.copy() for output in first]
    second = network(crop(224, 200))
    assert not np.array_equal(first[0], second[0])
    for output, copy in zip(first, kept, strict=True):
        np.testing.assert_array_equal(output, copy)


def test_a_black_crop_is_no_hand(models: Path) -> None:
    _, presence, _, _ = Network((models / LANDMARKS.file).read_bytes)(crop(224, 0))
    assert 0 <= presence[0] < 0.1


def fail_inside() -> None:
    with _without_notes():
        os.write(2, b"WARNING: old\n")
        raise ValueError("inside")


def test_notes_of_the_runtime_are_held_back_and_errors_are_not(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with _without_notes():
        os.write(2, b"INFO: Created a delegate.\nERROR: The model is broken.\n")
    os.write(2, b"INFO: later\n")
    assert capfd.readouterr().err == "ERROR: The model is broken.\nINFO: later\n"
    with pytest.raises(ValueError, match="inside"):
        fail_inside()
    assert capfd.readouterr().err == "WARNING: old\n"


def test_a_network_says_nothing_when_it_works(
    models: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    Network((models / PALMS.file).read_bytes)(crop(192, 0))
    assert capfd.readouterr().err == ""
