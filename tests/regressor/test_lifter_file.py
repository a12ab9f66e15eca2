"""The file of a lifter: a round trip in half precision, and every file that must not be taken."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from hand_recon.camera import default_intrinsics
from hand_recon.hand.model import HandModel
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.lifter_file import (
    LifterSettings,
    fingerprint,
    lifter_header,
    load_lifter,
    save_lifter,
    weights_digest,
)
from hand_recon.schema import HandBatch
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views

SETTINGS = LifterSettings(width=24, depth=1, iterations=2, confidence=False)


@pytest.fixture
def lifter(hand: HandModel) -> Regressor:
    network = SETTINGS.build(hand)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.02 * torch.randn_like(parameter))
    return network.eval()


@pytest.fixture
def file(lifter: Regressor, tmp_path: Path) -> Path:
    save_lifter(tmp_path / "folder" / "own.safetensors", lifter, SETTINGS, {"command": "a test"})
    return tmp_path / "folder" / "own.safetensors"


def rewritten(
    file: Path, change: Callable[[dict[str, str], dict[str, torch.Tensor]], object]
) -> Path:
    """The file with its header or its weights changed."""
    with safe_open(file, framework="pt") as opened:
        header = dict(opened.metadata())
        weights = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118
    change(header, weights)
    save_file(weights, file, header)
    return file


def test_a_file_gives_the_same_network_in_half_precision(
    hand: HandModel, lifter: Regressor, file: Path
) -> None:
    found = load_lifter(file, lambda *_: hand)
    assert not found.training
    assert found.hand is hand
    kept = lifter.state_dict()
    assert found.state_dict().keys() == kept.keys()
    for name, tensor in found.state_dict().items():
        assert tensor.dtype == torch.float32
        assert torch.equal(tensor, kept[name].half().float()), name
    assert lifter_header(file)["command"] == "a test"


def test_the_hand_is_asked_for_by_fingerprint_and_landmark_set(hand: HandModel, file: Path) -> None:
    asked = []

    def hands(wanted: str, landmark_set: str) -> HandModel:
        asked.append((wanted, landmark_set))
        return hand

    load_lifter(file, hands)
    assert asked == [(fingerprint(hand), "knuckle")]


def test_a_hand_that_is_not_here_is_refused(hand: HandModel, file: Path) -> None:
    with pytest.raises(ValueError, match=rf"made for the hand '{fingerprint(hand)}'.*lifter="):
        load_lifter(file, lambda *_: None)


def test_a_changed_weight_is_found(file: Path) -> None:
    def change(header: dict[str, str], weights: dict[str, torch.Tensor]) -> None:
        weights["initial_state"][0] += 0.5

    with pytest.raises(ValueError, match="damaged or was changed"):
        lifter_header(rewritten(file, change))


@pytest.mark.parametrize(
    "settings",
    [{"width": 24}, {"width": "24"}, {"_target_": "os.system"}, [], None, {**vars(SETTINGS), "x": 1},
     {**vars(SETTINGS), "width": 24.0}],
)  # fmt: skip
def test_settings_are_the_known_numbers_and_nothing_else(
    hand: HandModel, file: Path, settings: object
) -> None:
    changed = rewritten(file, lambda header, _: header.update(settings=json.dumps(settings)))
    with pytest.raises(ValueError, match="another version of hand_recon"):
        load_lifter(changed, lambda *_: hand)


def test_settings_that_are_no_json_are_refused(hand: HandModel, file: Path) -> None:
    changed = rewritten(file, lambda header, _: header.update(settings="{"))
    with pytest.raises(ValueError, match=r"has the settings \{; expected .*another version"):
        load_lifter(changed, lambda *_: hand)


@pytest.mark.parametrize("changes", [{"width": 0}, {"width": -3}, {"depth": -1}, {"iterations": 0}])
def test_settings_of_no_network_are_refused(
    hand: HandModel, file: Path, changes: dict[str, int]
) -> None:
    settings = json.dumps({**vars(SETTINGS), **changes})
    changed = rewritten(file, lambda header, _: header.update(settings=settings))
    with pytest.raises(ValueError, match=r"expected a width .*lifter=default"):
        load_lifter(changed, lambda *_: hand)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"width": 32}, r"has the shape \(.*24.*\); expected \(.*32.*\)"),
        ({"depth": 0}, r"encoder\.blocks\.0\.1\.bias has the shape \(24,\); expected None"),
        ({"depth": 2}, r"encoder\.blocks\.1\.1\.bias has the shape None; expected \(24,\)"),
        ({"reprojection": False}, "has the shape"),
    ],
)
def test_settings_of_another_network_are_refused(
    hand: HandModel, file: Path, changes: dict[str, Any], said: str
) -> None:
    settings = json.dumps({**vars(SETTINGS), **changes})
    changed = rewritten(file, lambda header, _: header.update(settings=settings))
    with pytest.raises(ValueError, match=rf"weights of another network .*{said}.*lifter=default"):
        load_lifter(changed, lambda *_: hand)


@pytest.mark.parametrize("entry", ["settings", "hand", "landmark_set", "weights"])
def test_a_header_without_an_entry_is_refused(hand: HandModel, file: Path, entry: str) -> None:
    changed = rewritten(file, lambda header, _: header.pop(entry))
    with pytest.raises(ValueError, match=rf"has no {entry} in its header; .*lifter=default"):
        load_lifter(changed, lambda *_: hand)


def test_another_format_is_refused(file: Path) -> None:
    changed = rewritten(file, lambda header, _: header.update(format="hand_recon lifter 2"))
    with pytest.raises(ValueError, match=r"format 'hand_recon lifter 2'; expected"):
        lifter_header(changed)


def test_what_is_no_lifter_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No lifter at .*lifter=none"):
        lifter_header(tmp_path / "none.safetensors")
    (tmp_path / "text.safetensors").write_text("not a file of tensors")
    with pytest.raises(ValueError, match="no safetensors file"):
        lifter_header(tmp_path / "text.safetensors")
    save_file({"a": torch.zeros(1)}, tmp_path / "other.safetensors")
    with pytest.raises(ValueError, match="has the format None"):
        lifter_header(tmp_path / "other.safetensors")


def test_the_digest_is_of_names_types_shapes_and_numbers() -> None:
    kept = weights_digest({"a": torch.zeros(2, 3), "b": torch.ones(1)})
    assert kept == weights_digest({"b": torch.ones(1), "a": torch.zeros(2, 3)})
    for changed in (
        {"a": torch.zeros(2, 3), "c": torch.ones(1)},
        {"a": torch.zeros(3, 2), "b": torch.ones(1)},
        {"a": torch.zeros(2, 3).half(), "b": torch.ones(1)},
        {"a": torch.zeros(2, 3), "b": 2 * torch.ones(1)},
    ):
        assert weights_digest(changed) != kept


@pytest.mark.parametrize("given", [False, True])
def test_parameters_alone_are_those_of_the_whole_prediction(
    hand: HandModel, *, given: bool
) -> None:
    network = SETTINGS.build(hand).eval()
    network.use_intrinsics = given
    seen = views(hand, known_hands(hand, 3), focal=800.0)
    batch = HandBatch(
        image=torch.empty(3, 3, 0, 0),
        landmarks_2d=seen.landmarks_2d,
        labelled=seen.labelled,
        index=seen.index,
        source=seen.source,
        intrinsics=default_intrinsics(224, seen.landmarks_2d).expand(3, 3, 3)
        if not given
        else seen.intrinsics,
    )
    with torch.no_grad():
        expected, found = network(batch).parameters, network.place(batch)
    for name, value in vars(expected).items():
        assert_close(getattr(found, name), value)
