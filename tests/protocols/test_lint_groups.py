"""Lint: mistakes in a part of the frames only, and sequences in another order."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from hand_recon.evaluation.scores import HandPoints
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import landmark_permutation
from hand_recon.protocols.benchmarks import PROTOCOLS
from hand_recon.protocols.lint.blocks import block_displacements
from hand_recon.protocols.lint.frames import frame_ranges, read_frame_names, sequences_of
from hand_recon.protocols.lint.lint import Finding, closing_line, lint
from tests.support.bad_predictions import BAD_BUT_RIGHT
from tests.support.predicted_hands import changed, mistakes, noisy, true_hands

FREIHAND, HO3D, DEXYCB = (PROTOCOLS[name] for name in ("freihand", "ho3d_v2", "dexycb"))

COUNT = 160


def where(chosen: Tensor, change: Callable[[Tensor], Tensor]) -> Callable[[Tensor], Tensor]:
    """Apply a change to the chosen frames only."""
    return lambda points: torch.where(chosen[:, None, None], change(points), points)


def landmarks_of(hand: HandModel, count: int = COUNT, seed: int = 3) -> HandPoints:
    return HandPoints(true_hands(hand, count, seed).landmarks)


def only(findings: tuple[Finding, ...]) -> Finding:
    (found,) = findings
    return found


# --- units --------------------------------------------------------------------------------------

LAST = torch.arange(COUNT) >= 104
EVERY_THIRD = torch.arange(COUNT) % 3 == 0
MOST = torch.arange(COUNT) < 112


@pytest.mark.parametrize(
    ("name", "chosen", "factor", "words"),
    [
        ("freihand", LAST, 1000, r"56 of your 160 frames (35 %) look to be in mm"),
        ("freihand", EVERY_THIRD, 100, r"54 of your 160 frames (34 %) look to be in cm"),
        ("freihand", MOST, 1000, "112 of your 160 frames (70 %) look to be in mm"),
        ("dexycb", LAST, 0.001, "56 of your 160 frames (35 %) look to be in m and the others"),
        ("freihand", torch.arange(COUNT) == 17, 1000, "frames 17: E_J_unaligned"),
        ("ho3d_v2", LAST, 1000, "frames 104 to 159: E_J_unaligned"),
    ],
)
def test_frames_in_another_unit_than_the_others_are_named(
    hand: HandModel, name: str, chosen: Tensor, factor: float, words: str
) -> None:
    protocol, ground_truth = PROTOCOLS[name], landmarks_of(hand)
    file = protocol.from_internal(noisy(ground_truth, 0.005))
    wrong = changed(file, where(chosen, lambda points: points * factor))
    found = only(lint(protocol.from_internal(ground_truth), wrong, protocol))
    assert (found.kind, found.confidence) == ("some_unit", "certain")
    assert words in found.message
    assert f"multiply these by {1 / factor:g}" in found.message
    # 5 mm on every coordinate: √(8/π) · 5 = 8.0 mm on average.
    assert found.score_if_mended == pytest.approx(8.0, abs=0.5)
    assert found.score_if_mended is not None
    assert found.score_now > 10 * found.score_if_mended


def test_two_wrong_units_are_two_findings(hand: HandModel) -> None:
    ground_truth = landmarks_of(hand)
    number = torch.arange(COUNT)
    factor = torch.ones(COUNT).double()
    factor[number < 40], factor[number >= 140] = 1000, 100
    wrong = changed(ground_truth, lambda points: points * factor[:, None, None])
    findings = lint(ground_truth, wrong, FREIHAND)
    assert [found.kind for found in findings] == ["some_unit", "some_unit"]
    assert "frames 0 to 39" in findings[0].message
    assert "frames 140 to 159" in findings[1].message


def test_a_whole_file_in_one_wrong_unit_is_no_part(hand: HandModel) -> None:
    ground_truth = landmarks_of(hand)
    wrong = changed(ground_truth, lambda points: points * 1000)
    assert only(lint(ground_truth, wrong, FREIHAND)).kind == "unit"


def test_another_mistake_is_found_beside_the_unit_of_some_frames(hand: HandModel) -> None:
    ground_truth = landmarks_of(hand)
    index = list(landmark_permutation("freihand", "ho3d"))
    wrong = changed(ground_truth, where(LAST, lambda points: points * 1000))
    findings = lint(ground_truth, changed(wrong, lambda points: points[:, index]), FREIHAND)
    assert sorted(mistakes(findings)) == ["order", "some_unit"]


# --- order and axes of a part -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (lambda points: points * points.new_tensor([1.0, -1.0, -1.0]), "axes", "negate y and z"),
        (
            lambda points: points[:, list(landmark_permutation("freihand", "rhd"))],
            "order",
            "in RHD's order",
        ),
    ],
)
def test_a_part_in_other_axes_or_another_order_is_found(
    hand: HandModel, change: Callable[[Tensor], Tensor], kind: str, words: str
) -> None:
    ground_truth = landmarks_of(hand)
    wrong = changed(noisy(ground_truth, 0.005), where(torch.arange(COUNT) >= 120, change))
    found = only(lint(ground_truth, wrong, FREIHAND))
    assert found.kind == kind
    assert words in found.message
    assert (
        "A part of your frames (about frames 120 to 159) differs from the others" in found.message
    )
    assert found.score_if_mended is not None
    assert found.score_if_mended < 0.7 * found.score_now


@pytest.mark.parametrize("name", BAD_BUT_RIGHT)
def test_no_part_of_a_file_without_mistakes_raises_an_alarm(hand: HandModel, name: str) -> None:
    ground_truth = true_hands(hand, COUNT, seed=5)
    for protocol in (FREIHAND, HO3D):
        file = protocol.from_internal(BAD_BUT_RIGHT[name](ground_truth))
        assert mistakes(lint(protocol.from_internal(ground_truth), file, protocol)) == []


# --- sequences ----------------------------------------------------------------------------------


def blocks(*parts: tuple[int, int]) -> Tensor:
    """Frames of the parts, one after the other."""
    return torch.cat([torch.arange(first, last) for first, last in parts])


@pytest.mark.parametrize("metres", [0.0, 0.005, 0.008])
def test_sequences_in_another_order_are_described(hand: HandModel, metres: float) -> None:
    ground_truth = landmarks_of(hand)
    order = blocks((60, 110), (0, 60), (110, 160))
    found = only(lint(ground_truth, noisy(ground_truth[order], metres), FREIHAND))
    assert found.kind == "frame_order"
    assert "your frames 0 to 49 fit the ground truth of 60 to 109" in found.message
    assert "your frames 50 to 109 fit the ground truth of 0 to 59" in found.message
    assert "evaluation.txt" in found.message
    assert found.score_if_mended is not None
    assert found.score_if_mended < 0.75 * found.score_now


def test_frames_after_a_lost_one_are_displaced_by_one(hand: HandModel) -> None:
    ground_truth = landmarks_of(hand)
    order = blocks((0, 70), (71, 160), (159, 160))
    found = lint(ground_truth, noisy(ground_truth[order], 0.005), FREIHAND)[0]
    assert found.kind == "frame_order"
    assert "your frames 70 to 158 fit the ground truth of 71 to 159" in found.message
    assert "as after frames that are missing or doubled" in found.message


@pytest.mark.parametrize("shift", [-7, 5])
def test_frames_that_are_all_displaced_alike_are_said_to_be(hand: HandModel, shift: int) -> None:
    ground_truth = landmarks_of(hand)
    order = (torch.arange(COUNT) + shift).clamp(0, COUNT - 1)
    found = lint(ground_truth, noisy(ground_truth[order], 0.005), FREIHAND)[0]
    assert found.kind == "frame_order"
    first, last = max(0, -shift), COUNT - 1 - max(0, shift)
    assert (
        "as after frames that are missing or doubled: your frames "
        f"{first} to {last} fit the ground truth of {first + shift} to {last + shift}"
    ) in found.message


def test_displacements_are_those_of_the_blocks() -> None:
    """Distances of 1, and of 0 at the fitting frame: blocks 40–95, 0–39."""
    fitting = blocks((40, 96), (0, 40))
    distance = torch.ones(96, 96)
    distance[torch.arange(96), fitting] = 0
    shifts = block_displacements(distance, torch.arange(96))
    assert shifts is not None
    assert shifts.tolist() == [40] * 56 + [-56] * 40
    assert block_displacements(1 - torch.eye(96), torch.arange(96)) is None
    assert block_displacements(torch.rand(96, 96), torch.arange(96)) is None
    assert block_displacements(distance[:40, :40], torch.arange(40)) is None


# --- words --------------------------------------------------------------------------------------


def test_an_open_question_leaves_no_all_clear(hand: HandModel) -> None:
    ground_truth = landmarks_of(hand, 40, seed=0)
    shuffled = noisy(ground_truth, 0.01)[torch.randperm(40)]
    findings = lint(ground_truth, shuffled, FREIHAND)
    assert [found.kind for found in findings] == ["unrelated"]
    assert closing_line(findings) is None
    tiny = changed(ground_truth, lambda points: points * 0.03)
    assert closing_line(lint(ground_truth, tiny, FREIHAND)) is None
    assert closing_line(lint(ground_truth, ground_truth, FREIHAND)) == (
        "No mistake found in order, unit, axes, side or sequence."
    )


def test_frames_are_written_as_ranges() -> None:
    assert frame_ranges(torch.tensor([3])) == "3"
    assert frame_ranges(torch.tensor([3, 4, 5, 9])) == "3 to 5, 9"
    assert frame_ranges(torch.tensor([0, 40, 80, 200]), gap=40) == "0 to 80, 200"
    assert frame_ranges(torch.tensor([0, 2, 4, 6, 8])) == "0, 2, 4 and 2 more ranges"


def test_sequences_are_named_where_the_list_of_frames_is_there(
    hand: HandModel, tmp_path: Path
) -> None:
    names = [f"{'SM1' if frame < 104 else 'MPM10'}/{frame:04d}" for frame in range(COUNT)]
    (tmp_path / "evaluation.txt").write_text("\n".join(names))
    (tmp_path / "gt").mkdir()
    read = read_frame_names(tmp_path / "gt", COUNT)
    assert read == tuple(names)
    assert read_frame_names(tmp_path, COUNT - 1) is None
    ground_truth = landmarks_of(hand)
    wrong = changed(ground_truth, where(LAST, lambda points: points * 1000))
    found = only(lint(ground_truth, wrong, FREIHAND, names=read))
    assert "frames 104 to 159 (MPM10)" in found.message
    many = [f"{letter}/0" for letter in "abcdefg"]
    assert sequences_of(many, torch.ones(7).bool()) == " (a, b, c, d, e and 2 more)"
    assert sequences_of(["0", "1"], torch.ones(2).bool()) == ""


def video(hand: HandModel, count: int, seed: int) -> HandPoints:
    """A hand that moves smoothly from one pose to another in every 40 frames."""
    poses = true_hands(hand, count // 40 + 2, seed).landmarks
    time = torch.arange(count).double() / 40
    pose, share = time.long(), (time % 1)[:, None, None]
    share = share * share * (3 - 2 * share)
    return HandPoints(poses[pose] * (1 - share) + poses[pose + 1] * share)


@pytest.mark.parametrize("error", ["none", "noise", "drift", "other"])
def test_a_video_without_mistakes_raises_no_alarm_however_bad_it_is(
    hand: HandModel, error: str
) -> None:
    ground_truth = video(hand, 400, seed=1)
    other = video(hand, 400, seed=51).landmarks
    other = other - other.mean(dim=1, keepdim=True)
    middle = ground_truth.landmarks.mean(dim=1, keepdim=True)
    prediction = {
        "none": ground_truth.landmarks,
        "noise": noisy(ground_truth, 0.02).landmarks,
        # Errors that neighbouring frames share, as a network makes them.
        "drift": ground_truth.landmarks + 0.3 * other,
        "other": other + middle,
    }[error]
    assert mistakes(lint(ground_truth, HandPoints(prediction), FREIHAND)) == []
