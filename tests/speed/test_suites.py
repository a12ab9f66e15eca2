"""Every suite measures what it names; runs are too short here for their numbers to mean anything."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from hand_recon.command_line.processor import usable_cores
from hand_recon.hand.open_hand import open_hand
from hand_recon.speed.measurement import Settings
from hand_recon.speed.poses import joint_angles, shapes
from hand_recon.speed.rows import LeftOut, Row
from hand_recon.speed.suites import SUITES, fit, inference, layer, physics, scaling, startup, step

QUICK = Settings(seconds=0.0, quick=True)


def rows_of(found: list[Row | LeftOut]) -> list[Row]:
    """The measured rows, with sound times."""
    rows = [one for one in found if isinstance(one, Row)]
    for row in rows:
        assert 0 < row.seconds.low <= row.seconds.median <= row.seconds.high
        if row.reference is not None:
            assert row.ratio is not None
            assert row.reference_seconds is not None
    return rows


def test_every_suite_is_a_module() -> None:
    for name in SUITES:
        assert importlib.util.find_spec(f"hand_recon.speed.suites.{name}") is not None, name


def test_the_layer_suite_compares_equal_layers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layer, "BATCHES", (1, 3, 4))
    found = list(layer.measure(QUICK))
    rows = rows_of(found)
    assert {row.size for row in rows} == {"1 hand", "3 hands"}
    assert all(float(row.difference.split()[0]) < 1e-6 for row in rows)
    reasons = {one.work: one.reason for one in found if isinstance(one, LeftOut)}
    assert reasons["compiled layer"] == "quick=true"
    if importlib.util.find_spec("smplx") is None:
        assert reasons["comparison with smplx"] == "smplx is not installed"


def test_the_physics_suite_scales_the_recipe(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(physics, "agreement", lambda kind: "")
    monkeypatch.setattr(physics, "BATCH", 4)
    monkeypatch.setattr(physics, "FEW", 1)
    natural, wild = rows_of(list(physics.measure(QUICK)))
    assert (natural.work, wild.work) == (
        "non-penetration, natural poses",
        "non-penetration, wild poses",
    )
    assert natural.ratio is not None
    # One hand of the recipe takes longer than four of ours, by far.
    assert natural.ratio.median > 10


def test_the_step_without_backbone_trains_the_features() -> None:
    module, batch = step.training_module(3)
    step.step_without_backbone(module, batch)
    features = module.regressor.encoder.get_parameter("features")
    assert features.grad is not None
    assert features.grad.isfinite().all()
    assert features.grad.abs().sum() > 0
    assert {"range_of_motion", "non_penetration", "shape"} <= set(module.prior.terms)


def test_the_scaling_suite_counts_all_knowledge(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scaling, "BATCHES", (1, 2))
    rows = rows_of(list(scaling.measure(QUICK)))
    assert {(row.work, row.items) for row in rows} == {
        (work, count) for work in ("hand", "all knowledge") for count in (1, 2)
    }
    assert (
        scaling.knowledge_work(2, "cpu", "all knowledge")()
        > scaling.knowledge_work(2, "cpu", "hand")()
    )


@pytest.mark.slow
def test_the_fit_suite_fits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(fit, "BATCHES", (1, 2))
    monkeypatch.setattr(fit, "ADAM_HANDS", 0)
    rows = rows_of(list(fit.measure(Settings(seconds=0.0, quick=True, cache=str(tmp_path)))))
    assert [(row.work.split()[0], row.items) for row in rows] == [
        ("fit", 1), ("lifter", 1), ("fit", 2), ("lifter", 2),
    ]  # fmt: skip


def test_the_startup_suite_runs_each_command(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = {"nothing": ("-c", ""), "a second": ("-c", "import time; time.sleep(1)")}
    monkeypatch.setattr(startup, "COMMANDS", commands)
    nothing, second = rows_of(list(startup.measure(QUICK)))
    assert second.seconds.median >= 1
    assert nothing.seconds.median < second.seconds.median


@pytest.mark.slow
def test_the_inference_suite_compares_the_forms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inference, "BATCHES", (2,))
    rows = rows_of(list(inference.measure(QUICK)))
    forms = {row.work for row in rows}
    assert "packaged lifter, onnxruntime, 8 bits" in forms
    assert "network for photographs, random weights, onnxruntime" in forms
    if usable_cores() > 1:
        assert "packaged lifter, PyTorch, 2 threads" in forms
        assert "packaged lifter beside a busy process, 2 threads that sleep" in forms
    exact = [row for row in rows if row.work.endswith(", onnxruntime")]
    assert all(float(row.difference.split()[0]) < 0.1 for row in exact)


UNBROKEN = """
import torch
from hand_recon.schema import HandParameters
from hand_recon.speed.poses import blended_hand, joint_angles, shapes

hand = blended_hand()
for count in (3, 20):
    parameters = HandParameters(
        joint_angles("natural", count), shapes(count), torch.eye(3).expand(count, 3, 3), torch.ones(count, 3)
    )
    # The backend that runs the graph as it is needs no compiler; a break in the graph is an error.
    whole = torch.compile(hand.to_camera, fullgraph=True, backend="eager", dynamic=False)
    found, expected = whole(parameters), hand.to_camera(parameters)
    torch.testing.assert_close(found.vertices, expected.vertices)
    torch.testing.assert_close(found.landmarks, expected.landmarks)
"""


def test_the_hand_layer_is_one_graph() -> None:
    # Checks of shapes, which only tests have, would break the graph.
    words = [sys.executable, "-c", UNBROKEN]
    run = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603  # our own words
    assert run.returncode == 0, run.stderr[-2000:]


@pytest.mark.parametrize("count", [1, 16, 17, 40])
def test_hands_in_lots_are_the_hands_alone(count: int) -> None:
    hand = open_hand()
    angles, shape = joint_angles("wild", count), shapes(count)
    together = hand(angles, shape).vertices
    alone = torch.cat(
        [hand(one[None], beta[None]).vertices for one, beta in zip(angles, shape, strict=True)]
    )
    torch.testing.assert_close(together, alone)
