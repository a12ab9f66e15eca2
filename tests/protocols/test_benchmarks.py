import pytest
import torch

from hand_recon.evaluation.scores import HandPoints
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.protocols.benchmarks import PROTOCOLS, protocol_named, report_scores
from tests.support.golden import SCORES, golden_hands
from tests.support.predicted_hands import noisy, true_hands
from tests.support.tolerance import assert_close


@pytest.mark.parametrize("name", PROTOCOLS)
def test_converting_to_a_file_and_back_changes_nothing(name: str) -> None:
    points = HandPoints(torch.randn(2, 21, 3).double(), torch.randn(2, 5, 3).double())
    back = PROTOCOLS[name].to_internal(PROTOCOLS[name].from_internal(points))
    assert_close(back.landmarks, points.landmarks)
    assert back.vertices is not None
    assert points.vertices is not None
    assert_close(back.vertices, points.vertices)


def test_ho3d_has_the_thumb_last_its_tip_sixteenth_and_the_hand_at_negative_z() -> None:
    points = HandPoints(torch.arange(21.0)[None, :, None] + torch.tensor([0.0, 100.0, 200.0]))
    written = PROTOCOLS["ho3d_v3"].from_internal(points).landmarks[0]
    tip = float(LANDMARKS.index("thumb tip"))
    assert written[16].tolist() == [tip, -(tip + 100), -(tip + 200)]
    assert bool((written[:, 2] < 0).all())


def test_dexycb_is_in_millimetres() -> None:
    written = PROTOCOLS["dexycb"].from_internal(HandPoints(torch.ones(1, 21, 3))).landmarks
    assert written.tolist() == [[[1000.0] * 3] * 21]


@pytest.mark.parametrize("case", ["noise", "mirror_x"])
@pytest.mark.parametrize(("name", "key"), [("freihand", "freihand"), ("ho3d_v3", "ho3d_v3")])
def test_scores_after_conversion_are_the_official_ones(name: str, key: str, case: str) -> None:
    """Golden hands converted to the file's order, axes and unit and back."""
    protocol = PROTOCOLS[name]
    ground_truth, prediction = (
        protocol.to_internal(protocol.from_internal(points)) for points in golden_hands(case)
    )
    scores = protocol.scores(ground_truth, prediction)
    assert {name: round(value, 6) for name, value in scores.items()} == SCORES[case][key]


def test_without_a_mesh_its_scores_are_minus_one_and_the_landmarks_are_unchanged(
    hand: HandModel,
) -> None:
    ground_truth = true_hands(hand, 3)
    prediction = noisy(ground_truth, 0.01)
    whole = PROTOCOLS["freihand"].scores(ground_truth, prediction)
    alone = PROTOCOLS["freihand"].scores(ground_truth, HandPoints(prediction.landmarks))
    assert alone.keys() == whole.keys()
    for name, value in alone.items():
        assert value == (whole[name] if name.startswith("xyz") else -1)


def test_the_papers_names_are_in_millimetres_and_proper_is_there_where_it_differs() -> None:
    official = PROTOCOLS["freihand"].scores(*golden_hands("noise"))
    error = 10 * official["xyz_al_mean3d"]
    ours = report_scores(official, error, (1.0, 2.0))
    assert ours["E_J"] == error
    assert ours["E_V"] == 10 * official["mesh_al_mean3d"]
    assert "E_J_proper" not in ours
    assert report_scores(official, 2 * error, (1.0, 2.0))["E_J_proper"] == 2 * error


def test_an_unknown_protocol_lists_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"'ho3d'.*freihand, ho3d_v2, ho3d_v3, dexycb"):
        protocol_named("ho3d")
