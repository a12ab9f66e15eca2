import json
import zipfile
from pathlib import Path

import pytest
import torch

from hand_recon.evaluation.scores import HandPoints
from hand_recon.hand.model import HandModel
from hand_recon.protocols.benchmarks import PROTOCOLS
from hand_recon.protocols.prediction_files import read_predictions
from hand_recon.protocols.submission import write_submission
from tests.support.predicted_hands import noisy, true_hands

NAMES = ["freihand", "ho3d_v3", "dexycb"]


@pytest.mark.parametrize("name", NAMES)
def test_what_is_written_is_read_again_up_to_the_rounding(
    name: str, hand: HandModel, tmp_path: Path
) -> None:
    protocol, points = PROTOCOLS[name], true_hands(hand, 70)
    for path in write_submission(protocol, points, tmp_path / "out"):
        back = protocol.to_internal(read_predictions(path, protocol).points)
        # Half of the last digit, and the vertices' single precision.
        bound = 0.5001 * {"freihand": 1e-5, "ho3d_v3": 1e-4, "dexycb": 1e-5}[name]
        assert float((back.landmarks - points.landmarks).abs().max()) <= bound
        if protocol.scores_vertices:
            assert back.vertices is not None
            assert points.vertices is not None
            assert float((back.vertices - points.vertices).abs().max()) <= bound + 1e-7


@pytest.mark.parametrize("name", NAMES)
def test_rounding_changes_no_error_by_a_hundredth_of_a_millimetre(
    name: str, hand: HandModel, tmp_path: Path
) -> None:
    protocol, ground_truth = PROTOCOLS[name], true_hands(hand, 100)
    prediction = noisy(ground_truth, 0.003)
    path = write_submission(protocol, prediction, tmp_path)[0]
    read = protocol.to_internal(read_predictions(path, protocol).points)
    exact, rounded = protocol.scores(ground_truth, prediction), protocol.scores(ground_truth, read)
    if name == "dexycb":
        for alignment, values in exact.items():
            assert abs(values["mpjpe_mm"] - rounded[alignment]["mpjpe_mm"]) < 0.01
    else:
        for key, value in exact.items():
            assert abs(value - rounded[key]) < (0.001 if key.endswith("mean3d") else 0.005)


def test_the_zip_has_the_json_at_its_top_level(hand: HandModel, tmp_path: Path) -> None:
    text, archive = write_submission(PROTOCOLS["freihand"], true_hands(hand, 2), tmp_path)
    with zipfile.ZipFile(archive) as packed:
        assert packed.namelist() == ["pred.json"]
        assert packed.read("pred.json") == text.read_bytes()
    landmarks, vertices = json.loads(text.read_text())
    assert (len(landmarks), len(landmarks[0]), len(vertices), len(vertices[0])) == (2, 21, 2, 778)


def test_ho3ds_wrist_is_at_the_given_root_in_front_of_its_camera(
    hand: HandModel, tmp_path: Path
) -> None:
    protocol, points = PROTOCOLS["ho3d_v3"], true_hands(hand, 3)
    root = torch.tensor([[0.1, 0.2, 0.8], [0.0, 0.1, 0.6], [-0.1, 0.0, 0.9]])
    path = write_submission(protocol, points, tmp_path, root=root)[0]
    landmarks, vertices = (torch.tensor(some) for some in json.loads(path.read_text()))
    torch.testing.assert_close(landmarks[:, 0], root * torch.tensor([1.0, -1.0, -1.0]))
    assert bool((landmarks[..., 2] < 0).all())
    assert bool((vertices[..., 2] < 0).all())
    moved = protocol.to_internal(HandPoints(landmarks, vertices))
    assert points.vertices is not None
    assert moved.vertices is not None
    before = points.vertices - points.landmarks[:, :1]
    after = moved.vertices - moved.landmarks[:, :1]
    assert float((before - after).abs().max()) < 1.01e-4


def test_dexycbs_lines_have_their_ids_and_millimetres(tmp_path: Path) -> None:
    points = HandPoints(torch.full((2, 21, 3), 0.1234567).double())
    (path,) = write_submission(PROTOCOLS["dexycb"], points, tmp_path, ids=torch.tensor([7, 9]))
    assert path.read_text() == "7" + 63 * ",123.46" + "\n9" + 63 * ",123.46" + "\n"


def test_without_vertices_the_wrist_is_written_as_the_surface(tmp_path: Path) -> None:
    landmarks = torch.arange(63.0).reshape(1, 21, 3)
    path = write_submission(PROTOCOLS["freihand"], HandPoints(landmarks), tmp_path)[0]
    assert json.loads(path.read_text()) == [landmarks.tolist(), [[[0.0, 1.0, 2.0]]]]


@pytest.mark.parametrize("existing", ["pred.json", "pred.zip"])
def test_nothing_is_overwritten(existing: str, tmp_path: Path) -> None:
    (tmp_path / existing).write_text("mine")
    with pytest.raises(FileExistsError, match=rf"{existing} exists"):
        write_submission(PROTOCOLS["freihand"], HandPoints(torch.ones(1, 21, 3)), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [existing]


def test_infinite_predictions_and_missing_ids_are_refused(tmp_path: Path) -> None:
    points = HandPoints(torch.full((1, 21, 3), torch.nan))
    with pytest.raises(ValueError, match=r"landmarks of the samples 0 are not finite"):
        write_submission(PROTOCOLS["freihand"], points, tmp_path)
    with pytest.raises(ValueError, match=r"2 ids"):
        write_submission(
            PROTOCOLS["dexycb"], HandPoints(torch.ones(1, 21, 3)), tmp_path, ids=torch.arange(2)
        )
    assert not list(tmp_path.iterdir())
