"""`hand_recon.fit` from a file to a folder, and the test hands of a dataset to their scores."""

import csv
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.fitting import in_parts
from hand_recon.hand.model import HandModel
from hand_recon.runs import fit_run
from hand_recon.runs.fit_run import fit
from tests.support.fit_command import CAMERA, asked, entries_of, seen, write_landmarks


@pytest.fixture
def landmarks(hand: HandModel, tmp_path: Path) -> Path:
    return write_landmarks(hand, tmp_path)


def test_a_file_of_landmarks_becomes_a_folder_of_hands(
    hand: HandModel, landmarks: Path, tmp_path: Path
) -> None:
    output = tmp_path / "out"
    summary = fit(asked(output, f"landmarks={landmarks}", f"intrinsics={tmp_path / 'K.json'}"))
    assert (summary["hands"], summary["fitted"], summary["left"]) == (3, 2, 1)
    entries = entries_of(output)
    assert [entry["name"] for entry in entries] == ["a", "b", "c"]
    assert [entry["side"] for entry in entries] == ["right", "left", "right"]
    assert [entry["verdict"] != "not fitted" for entry in entries] == [True, True, False]
    shapes = {"landmarks_3d": (21, 3), "landmarks_2d": (21, 2),
              "shape": (10,)}  # fmt: skip
    given = json.loads(landmarks.read_text())
    for entry, source in zip(entries[:2], given, strict=False):
        for key, shape in shapes.items():
            assert np.shape(entry[key]) == shape, key
        sigma = np.array(entry["sigma_2d"])  # That of the confidences, which are all the same.
        pixels = np.array([p[:2] for p in source["landmarks"] if p is not None])
        side = (
            1.5 * np.ptp(pixels, axis=0).max()
        )  # Of the crop; a confidence of 0.9 is σ = 5/3 px of 224.
        given_sigma = 5.0 / 3.0 * side / 224
        known = [p is not None for p in source["landmarks"]]
        np.testing.assert_allclose(sigma[known], given_sigma, rtol=1e-4)
        assert entry["camera"]["source"] == "given"
        np.testing.assert_allclose(entry["camera"]["intrinsics"], CAMERA, atol=1e-3)
        points = np.array(entry["landmarks_3d"])
        projected = points / points[:, 2:] @ np.array(CAMERA).T
        np.testing.assert_allclose(projected[:, :2], entry["landmarks_2d"], atol=0.05)
        assert {"total", "data", "range_of_motion", "non_penetration", "shape"} <= set(
            entry["loss"]
        )
        off = [
            np.hypot(*np.subtract(found, point[:2]))
            for found, point in zip(entry["landmarks_2d"], source["landmarks"], strict=True)
            if point is not None
        ]
        assert np.mean(off) == pytest.approx(entry["residual"], abs=0.01)
        assert np.mean(off) < 12  # Thirty steps.
    assert entries[2]["landmarks_3d"] is None
    assert (output / "config.yaml").is_file()
    assert (output / "fits.png").is_file()
    assert len(list((output / "meshes").iterdir())) == 1
    assert len(list((output / "pictures").iterdir())) == 1


def test_a_left_hand_is_the_mirror_image_of_a_right_one(hand: HandModel, tmp_path: Path) -> None:
    # Eighths of pixels, which a mirror leaves exact: descent would make millimetres of a rounding.
    pixels = (seen(hand, 1)[0] * 8).round() / 8
    mirrored = pixels.clone()
    mirrored[..., 0] = 2 * CAMERA[0][2] - pixels[..., 0]
    found = []
    for side, points in (("right", pixels), ("left", mirrored)):
        path = tmp_path / f"{side}.json"
        path.write_text(json.dumps(points.tolist()))
        output = tmp_path / f"out_{side}"
        (tmp_path / "K.json").write_text(json.dumps(CAMERA))
        fit(asked(output, f"landmarks={path}", f"side={side}", f"intrinsics={tmp_path / 'K.json'}"))
        found.append(entries_of(output)[0])
    right, left = (np.array(entry["landmarks_3d"]) for entry in found)
    np.testing.assert_allclose(left * [-1, 1, 1], right, atol=1e-6)
    for joint, angles in found[0]["joint_angles_degrees"].items():
        assert found[1]["joint_angles_degrees"][joint] == pytest.approx(angles, abs=1e-3)


def test_without_a_camera_one_is_assumed_and_said_to_be(landmarks: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    fit(asked(output, f"landmarks={landmarks}"))
    entry = entries_of(output)[0]
    assert entry["camera"]["source"] == "assumed"
    K = np.array(entry["camera"]["intrinsics"])
    points = np.array(entry["landmarks_3d"])
    projected = points / points[:, 2:] @ K.T
    np.testing.assert_allclose(projected[:, :2], entry["landmarks_2d"], atol=0.05)


def test_a_folder_with_a_fit_in_it_is_not_written_to(landmarks: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    output.mkdir()
    (output / "hands.json").write_text("[]")
    with pytest.raises(FileExistsError, match=r"already holds hands\.json"):
        fit(asked(output, f"landmarks={landmarks}"))
    assert (output / "hands.json").read_text() == "[]"


def test_what_is_to_be_fitted_must_be_said_once(landmarks: Path, tmp_path: Path) -> None:
    for given, found in (([], "neither"), ([f"landmarks={landmarks}", "data=views"], "both")):
        with pytest.raises(ValueError, match=rf"either landmarks=.* or data=views.*found {found}"):
            fit(asked(tmp_path / "out", *given))
    assert not (tmp_path / "out").exists()


def test_a_folder_is_free_after_a_misspelt_lifter(landmarks: Path, tmp_path: Path) -> None:
    for name in ("defaults", "mine.safetensors"):
        with pytest.raises(FileNotFoundError, match=r"Found lifter=.*Give lifter=default"):
            fit(asked(tmp_path / "out", f"landmarks={landmarks}", f"lifter={name}"))
        assert not (tmp_path / "out").exists()


def test_correlations_are_not_to_be_had(landmarks: Path, tmp_path: Path) -> None:
    config = asked(tmp_path / "out", f"landmarks={landmarks}", "data_term=full_covariance")
    with pytest.raises(ValueError, match=r"cannot estimate correlations.*mse_then_nll"):
        fit(config)


def test_a_file_in_which_no_hand_was_found_leaves_nulls(tmp_path: Path) -> None:
    path = tmp_path / "none.json"
    path.write_text(json.dumps([None, [None] * 21]))
    with pytest.raises(ValueError, match=r"No hand was fitted, of 2; hands\.json has the reason"):
        fit(asked(tmp_path / "out", f"landmarks={path}"))
    entries = entries_of(tmp_path / "out")
    assert [entry["verdict"] for entry in entries] == ["not fitted", "not fitted"]
    assert all(entry["reasons"] for entry in entries)


def test_an_interrupted_fit_goes_on_with_all_of_its_results(
    landmarks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (f"landmarks={landmarks}", "results.meshes=3", "results.pictures=3")
    real, stops = in_parts.fit_in_parts, itertools.count()

    def one_by_one(hands: Any, fitter: Any, **options: Any) -> Any:  # noqa: ANN401
        interrupted = next(stops) in (1, 2)
        for number, part in enumerate(real(hands, fitter, size=1, **options)):
            if interrupted and number == 1:
                raise KeyboardInterrupt
            yield part

    monkeypatch.setattr(fit_run, "fit_in_parts", one_by_one)
    expected = fit(asked(tmp_path / "whole", *words))
    whole = (tmp_path / "whole" / "hands.json").read_bytes()
    output = tmp_path / "out"
    for done in (1, 2):
        with pytest.raises(KeyboardInterrupt):
            fit(asked(output, *words))
        assert len(json.loads((output / "hands.json.part").read_text())) == done
    summary = fit(asked(output, *words))
    assert (output / "hands.json").read_bytes() == whole
    assert summary == pytest.approx(expected, abs=1e-3)
    for folder in ("meshes", "pictures"):
        names = [
            sorted(path.name for path in (top / folder).iterdir())
            for top in (output, tmp_path / "whole")
        ]
        assert names[0] == names[1]
        assert len(names[0]) == 2
    assert (output / "fits.png").read_bytes() == (tmp_path / "whole" / "fits.png").read_bytes()


def test_strict_counts_the_hands_from_before_an_interruption(
    landmarks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All hands are done, and only the end of the command is missing."""
    monkeypatch.setattr(fit_run, "finish", lambda _: (_ for _ in ()).throw(KeyboardInterrupt))
    output = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        fit(asked(output, f"landmarks={landmarks}"))
    monkeypatch.undo()
    with pytest.raises(ValueError, match="1 are not fitted, which strict refuses"):
        fit(asked(output, f"landmarks={landmarks}", "strict=true"))
    assert len(entries_of(output)) == 3


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("scored")
    config = asked(
        folder / "out", "data=views", "hands=6", "descent.steps=60", "data.render_workers=1",
        f"paths.cache={folder / 'cache'}", "seed=3", "name=views_row5",
    )  # fmt: skip
    return folder / "out", fit(config)


def test_the_test_hands_of_a_dataset_are_scored(scored: tuple[Path, dict[str, Any]]) -> None:
    folder, metrics = scored
    assert json.loads((folder / "metrics.json").read_text()) == metrics
    assert (metrics["name"], metrics["data"], metrics["test_hands"]) == ("views_row5", "views", 6)
    assert {"E_J", "E_V", "E_2D", "PR", "ROM"} <= set(metrics["test"])
    # Sixty steps from noisy landmarks: far better than any constant hand.
    assert metrics["test"]["E_J"] < 20
    assert len(entries_of(folder)) == 6
    with (folder / "per_hand.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert sorted(int(row["index"]) for row in rows) == list(range(6))
    mean = np.mean([float(row["E_J"]) for row in rows])
    assert mean == pytest.approx(metrics["test"]["E_J"], rel=1e-4)


def test_another_seed_is_other_hands(scored: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    folder, _ = scored
    config = asked(
        tmp_path / "out", "data=views", "hands=6", "descent.steps=2", "data.render_workers=1",
        f"paths.cache={tmp_path / 'cache'}", "seed=4",
    )  # fmt: skip
    fit(config)
    first, second = (entries_of(where)[0]["landmarks_2d"] for where in (folder, tmp_path / "out"))
    assert not np.allclose(first, second, atol=20)
