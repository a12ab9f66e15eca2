"""Workers of columns: the numbers of the commands, and errors as values."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hand_recon
from hand_recon.detection.models import ModelsError
from hand_recon.fitting.hands_file import hand_entries
from hand_recon.fitting.objective import Fitted
from hand_recon.hand.model import HandModel
from hand_recon.plausibility.audit import audited
from hand_recon.plausibility.findings import Knowledge
from hand_recon.plausibility.posed_hands import HandModels
from hand_recon.plausibility.verdicts import Limits
from hand_recon.runs.audit.sources import Reading, read_given
from hand_recon.scale.audit_worker import AuditTask, AuditWorker
from hand_recon.scale.image_worker import ImageTask, ImageWorker
from hand_recon.scale.isolation import rows_or_errors
from hand_recon.scale.landmark_worker import LandmarkTask, LandmarkWorker, points_of
from hand_recon.scale.schema import NUMBERS, numbers
from hand_recon.scale.settings import plain_settings
from hand_recon.schema import HandBatch
from tests.support.photo_folder import CAMERA, QUICK


@pytest.fixture(scope="module")
def words(folder: Path) -> list[str]:
    return ["detector=landmarks", f"detector.landmarks='{folder}/found.json'", *QUICK]


@pytest.fixture(scope="module")
def worker(words: list[str]) -> ImageWorker:
    return ImageWorker(plain_settings("predict", words))


def photos_of(folder: Path) -> list[str]:
    return [str(path) for path in sorted((folder / "photos").iterdir())]


def assert_same(hand: dict[str, Any], entry: dict[str, Any]) -> None:
    """A hand of a column and one of a file of hands."""
    assert (hand["handedness"], hand["verdict"]) == (entry["side"], entry["verdict"])
    assert hand["camera"] == entry["camera"]["source"]
    for key, other in NUMBERS.items():
        if key in ("confidence", "joint_angles_degrees", "intrinsics"):
            continue
        if entry[other] is None:
            assert hand[key] is None, key
            continue
        np.testing.assert_allclose(hand[key], entry[other], rtol=1e-6, atol=1e-4, err_msg=key)
    np.testing.assert_allclose(hand["kp3d"], entry["landmarks_3d"], atol=2e-7)
    angles = [list(axes.values()) for axes in entry["joint_angles_degrees"].values()]
    np.testing.assert_allclose(hand["joint_angles_degrees"], angles, atol=1e-4)


def test_images_give_the_hands_of_the_command_and_errors_beside_them(
    folder: Path, words: list[str], worker: ImageWorker
) -> None:
    files = photos_of(folder)
    rows = worker([ImageTask(one) for one in [*files, None]])
    expected = hand_recon.reconstruct(files[:3], overrides=words)
    entries = list(hand_entries(expected.records))
    assert [len(row["hands"] or ()) for row in rows] == [2, 0, 1, 0, 0]
    hands = [hand for row in rows[:3] for hand in row["hands"]]
    for hand, entry in zip(hands, entries, strict=True):
        assert_same(hand, entry)
    assert [row["error"] for row in rows[:3]] == [None] * 3
    assert [(row["width"], row["height"]) for row in rows] == [(640, 480)] * 3 + [(None, None)] * 2
    assert rows[1]["hands"] == []
    # No hand is not the same as no result.
    assert rows[3]["hands"] is None
    assert "cut off" in rows[3]["error"]
    assert "image is null" in rows[4]["error"]


def test_each_image_can_have_a_camera_of_its_own(folder: Path, worker: ImageWorker) -> None:
    photo = photos_of(folder)[2]
    given, wrong = worker([ImageTask(photo, CAMERA), ImageTask(photo, [[1.0, 0.0]])])
    assert given["hands"][0]["camera"] == "given"
    np.testing.assert_allclose(given["hands"][0]["intrinsics"], CAMERA, rtol=1e-6)
    assert "intrinsics has the shape (1, 2); expected (3, 3)" in wrong["error"]


def test_an_image_whose_fit_fails_takes_no_other_with_it(
    folder: Path, worker: ImageWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first image has two hands, and a fit of two hands or of all fails."""
    fit = worker.fitter

    def failing(batch: HandBatch) -> Fitted:
        if len(batch.index) > 1:
            raise RuntimeError("singular")
        return fit(batch)

    monkeypatch.setattr(worker, "fitter", failing)
    rows = worker([ImageTask(one) for one in photos_of(folder)[:3]])
    assert [row["error"] for row in rows] == ["RuntimeError: singular", None, None]
    assert rows[0]["hands"] is None
    assert len(rows[2]["hands"]) == 1


def test_a_decoder_that_fails_in_its_own_way_is_a_row(
    folder: Path, worker: ImageWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise IndexError

    monkeypatch.setattr(type(worker.detector), "__call__", broken)
    assert worker([ImageTask(photos_of(folder)[0])])[0]["error"] == "IndexError"


def test_halves_are_tried_until_the_failing_items_are_alone() -> None:
    calls = []

    def run(items: Sequence[int]) -> list[int]:
        calls.append(len(items))
        if 5 in items:
            raise ValueError("five is refused")
        return [10 * item for item in items]

    rows = rows_or_errors(range(8), run, lambda item, error: -item if "five" in error else 0)
    assert rows == [0, 10, 20, 30, 40, -5, 60, 70]
    assert calls == [8, 4, 4, 2, 1, 1, 2]
    assert rows_or_errors([], run, lambda item, _: item) == []


@pytest.mark.parametrize("error", [ModelsError("no models"), ModuleNotFoundError("no LiteRT")])
def test_what_every_row_would_fail_with_is_raised(error: Exception) -> None:
    def run(_: Sequence[int]) -> list[int]:
        raise error

    with pytest.raises(type(error), match="no "):
        rows_or_errors([1, 2], run, lambda item, _: item)


def test_landmarks_give_the_hands_of_the_command(folder: Path) -> None:
    given = hand_recon.read_landmarks(folder / "found.json")
    points = given.landmarks_2d.numpy().copy()
    points[0, 4] = np.nan
    column: list[Any] = points.tolist()
    column[0][4] = None
    sides = ["right", "right", "left"]
    worker = LandmarkWorker(plain_settings("fit", QUICK))
    tasks = [LandmarkTask(*pair) for pair in zip(column, sides, strict=True)]
    wrong = [
        LandmarkTask(None, "right"), LandmarkTask(column[1], "up"), LandmarkTask([[1.0, 2.0]], "left"),
        LandmarkTask("points", "left"),
    ]  # fmt: skip
    rows = worker([*tasks[:1], *wrong, *tasks[1:]])
    expected = hand_recon.fit_landmarks(points, side=sides, overrides=QUICK)
    fitted = [rows[0], *rows[5:]]
    assert [row["error"] for row in fitted] == [None] * 3
    for row, entry in zip(fitted, hand_entries(expected.records), strict=True):
        np.testing.assert_allclose(row["hand"]["kp3d"], entry["landmarks_3d"], atol=1e-6)
        assert row["hand"]["verdict"] == entry["verdict"]
    assert rows[0]["hand"]["observed_2d"][4] is None
    told = (
        "landmarks are null",
        "side is",
        "shape (1, 2); expected (21, 2) or (42,)",
        "no array of numbers",
    )
    for row, text in zip(rows[1:5], told, strict=True):
        assert row["hand"] is None
        assert text in row["error"]


@pytest.mark.parametrize("axes", [2, 3])
def test_landmarks_are_accepted_point_after_point_alone(axes: int) -> None:
    points = np.arange(21.0 * axes).reshape(21, axes)
    for given in (points, points.ravel(), points.tolist(), points.ravel().tolist()):
        np.testing.assert_array_equal(points_of(given, axes), points)
    with pytest.raises(ValueError, match=rf"shape \({axes}, 21\); expected .* Transpose them"):
        points_of(points.T.tolist(), axes)
    for other in (points[None], points.reshape(7, -1)):
        with pytest.raises(ValueError, match=rf"expected \(21, {axes}\) or \({21 * axes},\)\.$"):
            points_of(other, axes)


@pytest.mark.slow
def test_landmarks_with_cameras_and_confidences(folder: Path) -> None:
    points = hand_recon.read_landmarks(folder / "found.json").landmarks_2d.numpy()[:2]
    confidence = np.linspace(0.3, 1.0, 21)
    worker = LandmarkWorker(plain_settings("fit", QUICK))
    rows = worker([LandmarkTask(one, "right", confidence, CAMERA) for one in points.tolist()])
    alone = worker([LandmarkTask(points[0].ravel().tolist(), "right")])
    expected = hand_recon.fit_landmarks(
        points, confidence=confidence, intrinsics=CAMERA, overrides=QUICK
    )
    for row, own in zip(rows, expected.landmarks_3d, strict=True):
        np.testing.assert_allclose(row["hand"]["kp3d"], own, atol=1e-6)
        assert row["hand"]["camera"] == "given"
    # A flat list is the same landmarks, here without a camera.
    assert alone[0]["hand"]["camera"] == "assumed"


def test_3d_landmarks_give_the_verdicts_of_the_command(
    folder: Path, hand: HandModel, tmp_path: Path
) -> None:
    photos = photos_of(folder)[:1]
    words = ["detector=landmarks", f"detector.landmarks='{folder}/found.json'", *QUICK]
    points = hand_recon.reconstruct(photos, overrides=words).landmarks_3d
    bent = points[0].copy()
    bent[8] = bent[7] + 1.5 * (bent[5] - bent[7])
    given = np.stack([points[0], points[1], bent])
    np.save(tmp_path / "given.npy", given)
    settings = plain_settings("audit", [])
    worker = AuditWorker(settings)
    models = HandModels.of(worker.models.fitted)
    read = read_given([tmp_path / "given.npy"], worker.models.fitted, None, Reading())
    expected = audited(read, models, Knowledge(worker.knowledge.ranges), Limits(), side="right")
    rows = worker([AuditTask(one, "right") for one in [*given.tolist(), None]])
    assert [row["verdict"] for row in rows] == [*(one.value for one in expected.verdicts), None]
    assert rows[2]["verdict"] == "implausible"
    assert rows[2]["reasons"] == list(expected.verdicts[2].reasons)
    for row, depth, angle in zip(
        rows[:3], expected.findings.depth, expected.findings.worst_range, strict=True
    ):
        assert row["depth_mm"] == pytest.approx(float(depth), abs=1e-3)
        assert row["worst_range_degrees"] == pytest.approx(float(angle), abs=1e-3)
    assert "landmarks are null" in rows[3]["error"]
    few = [point if index < 3 else None for index, point in enumerate(given[0].tolist())]
    assert worker([AuditTask(few)])[0]["verdict"] == "not audited"
    assert "side is 'up'" in worker([AuditTask(given[0], "up")])[0]["error"]


def test_settings_that_need_all_hands_or_belong_to_the_command_are_refused() -> None:
    with pytest.raises(ValueError, match="same_person=true, which needs all hands at once"):
        plain_settings("predict", ["same_person=true"])
    with pytest.raises(ValueError, match="'output=x' has no effect here"):
        plain_settings("fit", ["output=x"])


def test_missing_numbers_are_null() -> None:
    nan = np.nan
    assert numbers(np.array([[1.0, 2.0], [nan, 3.0]])) == [[1.0, 2.0], None]
    assert numbers(np.full((21, 2), nan)) is None
    assert numbers(nan) is None
    assert numbers(0.1) == np.float32(0.1)
    assert numbers(np.array([1.0, nan]))[0] == 1.0
