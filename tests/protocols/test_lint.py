"""Lint: every mistake is named with a remedy; `test_lint_alarms.py` has files without mistakes."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from hand_recon.evaluation.scores import LANDMARK_SCORES, HandPoints, landmark_scores
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARK_ORDERS, landmark_permutation
from hand_recon.protocols.benchmarks import PROTOCOLS, Protocol
from hand_recon.protocols.lint.evidence import clearly_better, spread_evenly
from hand_recon.protocols.lint.lint import Finding, lint
from tests.support.predicted_hands import changed, mistakes, noisy, true_hands

FREIHAND, HO3D, DEXYCB = (PROTOCOLS[name] for name in ("freihand", "ho3d_v3", "dexycb"))

COUNT = 40


def in_order(source: str, target: str) -> Callable[[Tensor], Tensor]:
    return lambda points: points[:, list(landmark_permutation(source, target))]


def times(*factors: float) -> Callable[[Tensor], Tensor]:
    return lambda points: points * points.new_tensor(factors)


def linted(
    hand: HandModel, protocol: Protocol, change: Callable[[HandPoints], HandPoints]
) -> tuple[Finding, ...]:
    """Findings for good predictions (5 mm on every coordinate) after a change of the file."""
    ground_truth = true_hands(hand, COUNT, seed=1)
    file = change(protocol.from_internal(noisy(ground_truth, 0.005)))
    return lint(protocol.from_internal(ground_truth), file, protocol)


ORDERS = [
    (protocol, order)
    for protocol in (FREIHAND, HO3D, DEXYCB)
    for order in LANDMARK_ORDERS
    if order != protocol.order
]


@pytest.mark.parametrize(
    ("protocol", "order"), ORDERS, ids=lambda value: str(getattr(value, "name", value))
)
def test_every_order_that_is_in_use_is_recognised(
    hand: HandModel, protocol: Protocol, order: str
) -> None:
    reorder = in_order(protocol.order, order)
    (found,) = linted(hand, protocol, lambda file: changed(file, reorder, lambda mesh: mesh))
    assert found.kind == "order"
    # The remedy in the message is the inverse permutation.
    assert f"landmarks[{list(landmark_permutation(order, protocol.order))}]" in found.message
    assert found.score_if_mended is not None
    assert found.score_if_mended < 10
    assert 1.1 * found.score_if_mended < found.score_now


def test_the_scores_before_and_after_are_those_of_the_files(hand: HandModel) -> None:
    ground_truth = true_hands(hand, COUNT)
    prediction = noisy(ground_truth, 0.005)
    wrong = changed(prediction, in_order("freihand", "ho3d"), lambda mesh: mesh)
    (found,) = lint(ground_truth, wrong, FREIHAND)
    column = LANDMARK_SCORES.index("E_J")
    now, corrected = (
        1000 * float(landmark_scores(ground_truth, file)[:, column].mean())
        for file in (wrong, prediction)
    )
    assert (found.score_now, found.score_if_mended) == pytest.approx((now, corrected))
    assert (
        f"in HO3D's order: E_J {now:.1f} -> {corrected:.1f} mm if you reorder them" in found.message
    )


def about_the_wrist(change: Callable[[Tensor], Tensor]) -> Callable[[HandPoints], HandPoints]:
    def moved(file: HandPoints) -> HandPoints:
        wrist = file.landmarks[:, :1]
        return changed(file, lambda points: change(points - wrist) + wrist)

    return moved


def placed(change: Callable[[Tensor], Tensor]) -> Callable[[HandPoints], HandPoints]:
    def moved(file: HandPoints) -> HandPoints:
        wrist = file.landmarks[:, :1]
        return changed(file, lambda points: points - wrist + change(wrist))

    return moved


def rows(index: Callable[[int], list[int]]) -> Callable[[HandPoints], HandPoints]:
    return lambda file: file[torch.tensor(index(len(file)))]


def landmarks_only(change: Callable[[Tensor], Tensor]) -> Callable[[HandPoints], HandPoints]:
    return lambda file: changed(file, change, lambda mesh: mesh)


def of_mesh(change: Callable[[Tensor], Tensor]) -> Callable[[HandPoints], HandPoints]:
    return lambda file: changed(file, lambda landmarks: landmarks, change)


def everywhere(change: Callable[[Tensor], Tensor]) -> Callable[[HandPoints], HandPoints]:
    return lambda file: changed(file, change)


def as_pixels(points: Tensor) -> Tensor:
    return torch.cat([500 * points[..., :2] / points[..., 2:] + 112, points[..., 2:]], dim=-1)


def left_handed(points: Tensor) -> Tensor:
    every_third = (torch.arange(len(points)) % 3 == 0)[:, None, None]
    return torch.where(every_third, points * points.new_tensor([-1.0, 1.0, 1.0]), points)


def mesh_shuffled(points: Tensor) -> Tensor:
    return points[:, torch.randperm(points.shape[1])]


CASES: dict[str, tuple[Protocol, Callable[[HandPoints], HandPoints], list[str], str]] = {
    "mm for m": (FREIHAND, everywhere(times(1000, 1000, 1000)), ["unit"], "multiply them by 0.001"),
    "cm for m": (HO3D, everywhere(times(100, 100, 100)), ["unit"], "multiply them by 0.01"),
    "m for mm": (DEXYCB, everywhere(times(0.001, 0.001, 0.001)), ["unit"], "multiply them by 1000"),
    "OpenGL for OpenCV": (FREIHAND, everywhere(times(1, -1, -1)), ["axes"], "negate y and z"),
    "OpenCV for OpenGL": (HO3D, everywhere(times(1, -1, -1)), ["axes"], "OpenCV's axes"),
    "OpenCV about the given root": (
        HO3D, about_the_wrist(times(1, -1, -1)), ["axes"], "relative to its root",
    ),
    "depth flipped": (FREIHAND, everywhere(times(1, 1, -1)), ["mirrored"], "negate z"),
    "mirrored": (DEXYCB, everywhere(times(-1, 1, 1)), ["mirrored"], "negate x"),
    "mirrored about the wrist": (FREIHAND, about_the_wrist(times(-1, 1, 1)), ["mirrored"], "negate x"),
    "some left hands": (DEXYCB, everywhere(left_handed), ["some_mirrored"], "negating x"),
    "root in other axes": (HO3D, placed(times(1, -1, -1)), ["position"], "negate y and z"),
    "root in mm": (FREIHAND, placed(times(1000, 1000, 1000)), ["position"], "multiply by 0.001"),
    "next frame": (FREIHAND, rows(lambda n: [*range(1, n), 0]), ["frame_order"], "of the next frame"),
    "frame before": (
        FREIHAND, rows(lambda n: [n - 1, *range(n - 1)]), ["frame_order"], "of the frame before",
    ),
    "reversed": (HO3D, rows(lambda n: list(range(n))[::-1]), ["frame_order"], "in reverse"),
    "sorted as text": (
        FREIHAND, rows(lambda n: sorted(range(n), key=str)), ["frame_order"], "sorted as text",
    ),
    "copied frames": (
        FREIHAND, rows(lambda n: [*range(10), *[10] * 10, *range(20, n)]), ["repeated"],
        "9 of your 40 predictions are copies of the one before, the first at frame 11",
    ),
    "pixels": (FREIHAND, everywhere(as_pixels), ["pixels"], "2D pixel coordinates"),
    "wrist last": (
        FREIHAND, landmarks_only(lambda points: points.roll(-1, dims=1)), ["order"], "wrist last",
    ),
    "reordered twice": (
        FREIHAND, landmarks_only(in_order("ho3d", "freihand")), ["order"], "once too often",
    ),
    "mesh in mm": (
        FREIHAND, of_mesh(times(1000, 1000, 1000)), ["joints_and_vertices"],
        "multiply the vertices by 0.001",
    ),
    "mesh in other axes": (
        HO3D, of_mesh(times(1, -1, -1)), ["joints_and_vertices"], "negate y and z of one",
    ),
    "mesh in another order": (FREIHAND, of_mesh(mesh_shuffled), ["vertex_order"], "MANO's order"),
    "order and unit": (
        DEXYCB, landmarks_only(lambda points: in_order("freihand", "dart")(points) / 1000),
        ["unit", "order"], "and correct the other findings",
    ),
    "order, unit and axes": (
        FREIHAND,
        lambda file: changed(
            changed(file, in_order("freihand", "ho3d"), lambda mesh: mesh), times(1000, -1000, -1000)
        ),
        ["axes", "order", "unit"], "in HO3D's order",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_mistake_is_named_with_a_remedy(hand: HandModel, name: str) -> None:
    protocol, change, kinds, words = CASES[name]
    if not protocol.scores_vertices:
        # Its files have no mesh.
        findings = linted(hand, protocol, lambda file: change(HandPoints(file.landmarks)))
    else:
        findings = linted(hand, protocol, change)
    assert sorted(mistakes(findings)) == sorted(kinds)
    assert any(words in finding.message for finding in findings)
    assert all(finding.gain > 0 or finding.score_if_mended is None for finding in findings)
    gains = [finding.gain for finding in findings if finding.confidence != "note"]
    assert gains == sorted(gains, reverse=True)


def test_shuffled_frames_are_found_if_the_predictions_are_good(hand: HandModel) -> None:
    ground_truth = true_hands(hand, COUNT)
    order = torch.randperm(COUNT)
    (found,) = lint(ground_truth, noisy(ground_truth, 0.002)[order], FREIHAND)
    assert found.kind == "frame_order"
    assert "shuffled" in found.message
    assert "ground truth of frame" in found.message


def test_shuffled_bad_predictions_are_only_noted_as_unrelated(hand: HandModel) -> None:
    ground_truth = true_hands(hand, COUNT)
    (found,) = lint(ground_truth, noisy(ground_truth, 0.01)[torch.randperm(COUNT)], FREIHAND)
    assert (found.kind, found.confidence) == ("unrelated", "note")


def test_a_mesh_about_another_origin_is_noted_even_without_a_true_one(hand: HandModel) -> None:
    ground_truth = true_hands(hand, COUNT)
    assert ground_truth.vertices is not None
    landmarks = HandPoints(ground_truth.landmarks)
    (found,) = lint(landmarks, landmarks, FREIHAND, ground_truth.vertices + 0.1)
    assert (found.kind, found.confidence) == ("joints_and_vertices", "note")


def test_an_order_in_a_flipped_file_is_found_whatever_the_axes_are(hand: HandModel) -> None:
    """The shape is compared with the hand and its mirror image, so that flipped axes do not matter."""
    flip = lambda points: in_order("freihand", "rhd")(points) * points.new_tensor([1.0, 1.0, -1.0])  # noqa: E731
    findings = linted(hand, FREIHAND, lambda file: changed(HandPoints(file.landmarks), flip))
    assert sorted(mistakes(findings)) == ["mirrored", "order"]


def test_a_gain_must_be_large_steady_and_beyond_chance() -> None:
    now = torch.full((100,), 0.02).double()
    assert clearly_better(now, now / 2, 0.3)
    assert not clearly_better(now, 0.8 * now, 0.3)
    # Half the error on average, but worse in a third of the frames.
    mixed = torch.where(torch.arange(100) % 3 == 0, 0.025, 0.002).double()
    assert not clearly_better(now, mixed, 0.3)
    # With three frames every one of them must improve.
    assert not clearly_better(now[:3], torch.tensor([0.0, 0.0, 0.019]).double(), 0.3)
    assert not clearly_better(now / 100, now / 200, 0.3)


@pytest.mark.parametrize(("count", "most"), [(1, 500), (500, 500), (501, 500), (3960, 500)])
def test_frames_are_spread_over_the_whole_set(count: int, most: int) -> None:
    frames = spread_evenly(count, most)
    assert len(frames) <= most
    assert frames[0] == 0
    assert count - int(frames[-1]) <= -(-count // most)
