"""ONNX files of lifters, read by onnxruntime: the same hands as PyTorch's, for any number of hands."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from hand_recon.fitting.lift import lift
from hand_recon.fitting.observation import Observation
from hand_recon.formats import onnx_file
from hand_recon.formats.onnx_graphs import LifterGraph
from hand_recon.hand.skeleton import ARTICULATED, LANDMARKS
from hand_recon.regressor.lifter_file import fingerprint
from tests.support.onnx_sessions import (
    SMALL,
    LifterFile,
    example_of,
    outputs_of,
    session_of,
    shapes_of,
)

LARGEST = 1e-4
"""Largest difference to PyTorch, metres."""


def inputs_of(lifter: LifterFile, hands: int) -> dict[str, torch.Tensor]:
    return example_of(LifterGraph(lifter.regressor), hands)


@pytest.mark.parametrize("hands", [1, 2, 7, 64])
def test_gives_the_hands_that_a_lifter_gives_in_a_fit(lifter_file: LifterFile, hands: int) -> None:
    inputs = inputs_of(lifter_file, hands)
    found = outputs_of(session_of(lifter_file.content), inputs)
    observation = Observation(inputs["observed_2d"], inputs["given"], inputs["intrinsics"])
    expected = lift(lifter_file.regressor, observation)
    parameters = expected.parameters
    for name, tensor, unit in (
        ("landmarks_3d", expected.landmarks_3d, 1.0),
        ("vertices", expected.vertices, 1.0),
        ("translation", parameters.translation, 1.0),
        ("root_rotation", parameters.root_rotation, 1.0),
        ("joint_angles", parameters.joint_angles, 1.0),
        ("shape", parameters.shape, 1.0),
        # A tenth of a millimetre half a metre away is a tenth of a pixel.
        ("landmarks_2d", expected.landmarks_2d, 1e3),
        ("sigma_2d", expected.log_sigma.exp(), 1e3),
    ):
        assert found[name].shape == tensor.shape, name
        assert np.abs(found[name] - tensor.numpy()).max() <= LARGEST * unit, name


def test_projections_and_triangles_belong_to_the_surface(lifter_file: LifterFile) -> None:
    inputs = inputs_of(lifter_file, 5)
    found = outputs_of(session_of(lifter_file.content), inputs)
    homogeneous = np.einsum("hij,hpj->hpi", inputs["intrinsics"].numpy(), found["landmarks_3d"])
    projected = homogeneous[..., :2] / homogeneous[..., 2:]
    assert np.abs(projected - found["landmarks_2d"]).max() < 0.01
    hand = lifter_file.regressor.hand
    assert np.array_equal(found["faces"], hand.faces.numpy())
    # The middle finger's MCP is the origin of the hand's frame, wherever its landmark is.
    posed = hand(torch.from_numpy(found["joint_angles"]), torch.from_numpy(found["shape"]))
    turned = posed.vertices.numpy() @ found["root_rotation"].swapaxes(1, 2)
    moved = turned + found["translation"][:, None]
    assert np.abs(moved - found["vertices"]).max() < 1e-5


def test_values_of_landmarks_that_are_not_given_do_not_matter(lifter_file: LifterFile) -> None:
    session, inputs = session_of(lifter_file.content), inputs_of(lifter_file, 3)
    expected = outputs_of(session, inputs)
    missing = ~inputs["given"]
    assert missing.any()
    for value in (math.nan, 1e9, 0.0):
        changed = inputs["observed_2d"].clone()
        changed[missing] = value
        found = outputs_of(session, inputs | {"observed_2d": changed})
        assert all(np.array_equal(found[name], expected[name]) for name in expected), value


def test_twice_as_large_an_image_gives_the_same_hand(lifter_file: LifterFile) -> None:
    session, inputs = session_of(lifter_file.content), inputs_of(lifter_file, 4)
    expected = outputs_of(session, inputs)
    larger = inputs | {
        "observed_2d": 2 * inputs["observed_2d"],
        "intrinsics": inputs["intrinsics"] * torch.tensor([[2.0], [2.0], [1.0]]),
    }
    found = outputs_of(session, larger)
    assert np.abs(found["vertices"] - expected["vertices"]).max() < 1e-4
    assert np.allclose(found["sigma_2d"], 2 * expected["sigma_2d"], rtol=1e-3)


def test_every_axis_of_hands_is_named_batch(lifter_file: LifterFile) -> None:
    shapes = shapes_of(session_of(lifter_file.content))
    assert shapes.pop("faces") == [1538, 3]
    assert shapes == {
        "observed_2d": ["batch", 21, 2],
        "given": ["batch", 21],
        "intrinsics": ["batch", 3, 3],
        "landmarks_3d": ["batch", 21, 3],
        "vertices": ["batch", 778, 3],
        "joint_angles": ["batch", 15, 3],
        "shape": ["batch", 10],
        "root_rotation": ["batch", 3, 3],
        "translation": ["batch", 3],
        "landmarks_2d": ["batch", 21, 2],
        "sigma_2d": ["batch", 21, 2],
    }


def test_the_file_describes_itself(lifter_file: LifterFile) -> None:
    import onnx

    model = onnx.load_from_string(lifter_file.content)
    onnx.checker.check_model(model, full_check=True)
    about = {entry.key: entry.value for entry in model.metadata_props}
    assert about["hand_recon_version"] == model.producer_version == "1.2.3"
    assert about["network"] == "lifter"
    assert about["hand_model"] == fingerprint(lifter_file.regressor.hand)
    assert about["landmark_set"] == "mediapipe"
    assert json.loads(about["landmark_order"]) == list(LANDMARKS)
    assert json.loads(about["joint_order"]) == list(ARTICULATED)
    units = json.loads(about["units"])
    values = [*model.graph.input, *model.graph.output]
    assert units == {value.name: value.doc_string for value in values}
    assert "metres" in units["vertices"]
    assert not any(tensor.external_data for tensor in model.graph.initializer)
    assert model.opset_import[0].version == onnx_file.OPSET
    # The file format of ONNX 1.15, which onnxruntime 1.17 reads; it refuses 10.
    assert model.ir_version == 9


def test_the_file_has_no_paths_of_the_machine_that_wrote_it(lifter_file: LifterFile) -> None:
    for trace in (b"stack_trace", b".py", str(Path(onnx_file.__file__).parents[2]).encode()):
        assert trace not in lifter_file.content, trace


def test_another_networks_file_is_noticed(lifter_file: LifterFile) -> None:
    other = SMALL.build(lifter_file.regressor.hand)
    with pytest.raises(
        ValueError, match=r"differs from PyTorch's by .* expected at most 0\.0001 m"
    ):
        onnx_file.check_agreement(LifterGraph(other.eval()), lifter_file.content)


def test_numbers_that_are_not_finite_are_a_difference(lifter_file: LifterFile) -> None:
    broken = SMALL.build(lifter_file.regressor.hand)
    broken.initial_state.fill_(math.nan)
    graph = LifterGraph(broken.eval())
    assert onnx_file.largest_difference(graph, lifter_file.content) == math.inf


def test_without_the_extra_its_name_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnx_file, "PACKAGES", ("onnx", "no_such_package"))
    with pytest.raises(ModuleNotFoundError, match=r"needs no_such_package.*hand_recon\[onnx\]"):
        onnx_file.check_installed()
