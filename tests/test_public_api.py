"""The library on one screen: landmarks in, hands out; losses and metrics in a training loop of one's own."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

import hand_recon
from hand_recon.hand.skeleton import ARTICULATED

EXAMPLE = Path(__file__).parents[1] / "examples" / "hands.json"
QUICK = ("descent.steps=20", "descent.starts=1")


def example_points() -> tuple[np.ndarray, list[str]]:
    """Landmarks and sides of the committed example; NaN where one is missing."""
    hands = json.loads(EXAMPLE.read_text())
    points = [
        [[np.nan] * 2 if one is None else one[:2] for one in hand["landmarks"]] for hand in hands
    ]
    return np.array(points), [hand["side"] for hand in hands]


def test_the_package_alone_imports_nothing_heavy() -> None:
    script = "import sys, hand_recon; assert {'torch', 'numpy'}.isdisjoint(sys.modules)"
    subprocess.run([sys.executable, "-c", script], check=True)  # noqa: S603  # our own words


def test_every_public_name_is_there_and_no_other() -> None:
    for name in hand_recon.__all__:
        assert getattr(hand_recon, name).__name__ == name
    assert set(hand_recon.__all__) <= set(dir(hand_recon))
    with pytest.raises(AttributeError, match="no attribute 'fit_pictures'"):
        hand_recon.fit_pictures  # noqa: B018  # the look-up is the test


def test_landmarks_in_hands_out(tmp_path: Path) -> None:
    points, sides = example_points()
    hands = hand_recon.fit_landmarks(points, side=sides, overrides=("descent.steps=60",))
    assert len(hands) == len(points) == 6
    assert hands.fitted.all()
    assert hands.vertices.shape[::2] == (6, 3)
    assert hands.landmarks_3d.shape == (6, 21, 3)
    assert hands.joint_angles_degrees.shape == (6, len(ARTICULATED), 3)
    # In front of the camera, as large as hands are, and where the landmarks were.
    assert (hands.landmarks_3d[..., 2] > 0).all()
    palm = np.linalg.norm(hands.landmarks_3d[:, 9] - hands.landmarks_3d[:, 0], axis=-1)
    assert ((palm > 0.06) & (palm < 0.13)).all()
    assert np.nanmean(np.linalg.norm(hands.landmarks_2d - points, axis=-1)) < 8
    drawing = hands.draw(tmp_path / "hands.png")
    sheet = cv2.imread(str(tmp_path / "hands.png"))
    assert sheet is not None
    np.testing.assert_array_equal(sheet[..., ::-1], drawing)
    assert sheet.std() > 10
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        hands.draw(tmp_path / "hands.png")
    folder = hands.save(tmp_path / "out")
    read = hand_recon.read_hands(folder / "hands.json")
    assert read.sides == tuple(sides)
    np.testing.assert_allclose(read.landmarks_3d, hands.landmarks_3d, atol=1e-6)


def test_the_function_and_the_command_agree(tmp_path: Path) -> None:
    points, sides = example_points()
    hands = hand_recon.fit_landmarks(points[:2], side=sides[:2], overrides=QUICK)
    entries = [
        {"side": side, "landmarks": [None if np.isnan(one).any() else one.tolist() for one in hand]}
        for hand, side in zip(points[:2], sides[:2], strict=True)
    ]
    (tmp_path / "hands.json").write_text(json.dumps(entries))
    command = [sys.executable, "-m", "hand_recon", "fit", "hands.json", "--output", "out", *QUICK]
    subprocess.run(command, cwd=tmp_path, check=True)  # noqa: S603  # our own words
    read = hand_recon.read_hands(tmp_path / "out" / "hands.json")
    np.testing.assert_allclose(read.landmarks_3d, hands.landmarks_3d, atol=1e-6)


def test_a_left_hand_is_the_mirror_image_of_a_right_one() -> None:
    points, _ = example_points()
    mirrored = points[:1] * [-1, 1] + [640, 0]
    right = hand_recon.fit_landmarks(points[:1], overrides=QUICK)
    left = hand_recon.fit_landmarks(mirrored, side="left", overrides=QUICK)
    np.testing.assert_allclose(left.joint_angles_degrees, right.joint_angles_degrees, atol=0.05)
    np.testing.assert_allclose(
        left.landmarks_2d, right.landmarks_2d * [-1, 1] + [640, 0], atol=0.05
    )


def test_landmarks_of_a_file_say_their_side_and_camera_themselves() -> None:
    read = hand_recon.read_landmarks(EXAMPLE)
    for given in ({"side": "left"}, {"intrinsics": np.eye(3)}, {"confidence": np.ones(21)}):
        with pytest.raises(ValueError, match="these landmarks have their own"):
            hand_recon.fit_landmarks(read, **given)


def test_a_fit_takes_gradients_where_its_caller_takes_none() -> None:
    points, _ = example_points()
    with torch.inference_mode():
        hands = hand_recon.fit_landmarks(torch.from_numpy(points[:1]), overrides=QUICK)
    assert hands.fitted.all()


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (np.zeros((2, 20, 2)), {}, r"shape \(2, 20, 2\); expected hand × 21 × 2"),
        (np.zeros((21, 3)), {}, r"expected hand × 21 × 2"),
        (np.zeros((2, 21, 2)), {"side": "both"}, "side is 'both'; expected right or left"),
        (np.zeros((2, 21, 2)), {"side": ["left"]}, "for each of 2 hands"),
        (np.zeros((21, 2)), {"confidence": np.full(21, 1.5)}, "not between 0 and 1"),
        (np.zeros((21, 2)), {"intrinsics": np.eye(2)}, r"intrinsics has the shape \(2, 2\)"),
        (np.zeros((21, 2)), {"intrinsics": np.zeros((3, 3))}, "no camera matrix"),
        (np.zeros((21, 2)), {"overrides": ["side=left"]}, "'side=left' has no effect here"),
        (np.zeros((21, 2)), {"overrides": "prior=none"}, "expected a list"),
    ],
)
def test_what_cannot_be_landmarks_is_refused(
    points: np.ndarray, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        hand_recon.fit_landmarks(points, **options)


def test_the_prior_teaches_a_network_of_ones_own() -> None:
    """README's example of losses: a step along the gradient leaves less outside the ranges."""
    hand = hand_recon.open_hand()
    prior = hand_recon.Prior.default(hand)
    angles = torch.full((4, 15, 3), 1.2, requires_grad=True)

    def loss() -> torch.Tensor:
        rotation = torch.eye(3).expand(4, 3, 3)
        parameters = hand_recon.HandParameters(
            angles, torch.zeros(4, 10), rotation, torch.zeros(4, 3)
        )
        terms = prior.weighted(prior(parameters, hand.to_camera(parameters).vertices))
        assert set(terms) == {"range_of_motion", "non_penetration", "shape"}
        return torch.stack(list(terms.values())).sum()

    optimizer = torch.optim.SGD([angles], lr=1e-6)
    before = loss()
    before.backward()
    optimizer.step()
    assert loss() < before


def test_penetration_is_a_loss_of_its_own() -> None:
    hand = hand_recon.open_hand()
    penetration = hand_recon.NonPenetration(hand)
    rest = hand(torch.zeros(15, 3), torch.zeros(10)).vertices
    assert float(penetration(rest[None])) == 0.0


def test_metrics_score_anybodys_points() -> None:
    """E_J of a prediction that is the ground truth, turned and shifted, is zero."""
    truth = torch.randn(8, 21, 3) * 0.05
    rotation = torch.linalg.qr(torch.randn(3, 3))[0]
    moved = truth @ (rotation * torch.det(rotation).sign()) * 1.3 + 0.2
    metrics = hand_recon.HandMetrics()
    metrics.update(hand_recon.HandPoints(moved), hand_recon.HandPoints(truth), torch.arange(8))
    scores = metrics.compute()
    assert scores["E_J"] == pytest.approx(0.0, abs=1e-3)
    # The first of the hundred thresholds is zero, which rounding exceeds.
    assert scores["AUC_J"] == pytest.approx(0.995, abs=1e-3)
