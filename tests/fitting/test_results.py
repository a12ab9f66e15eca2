"""Results of a fit: valid JSON, meshes that face outwards, and nothing overwritten."""

import csv
import dataclasses
import json
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from hand_recon.data.landmarks.crops import to_crops
from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.fitting.fitted_hands import fitted_hands
from hand_recon.fitting.results import ResultOptions, claim_results_folder, write_results
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARKS
from hand_recon.schema import HandParameters, HandPrediction
from tests.support.fitted_hands import CAMERA, SIDES, SMALL_RESULTS, fitted


def read(folder: Path) -> list[dict[str, Any]]:
    def refuse(token: str) -> None:
        raise AssertionError(f"{token} is not JSON")

    text = (folder / "hands.json").read_text(encoding="utf-8")
    entries: list[dict[str, Any]] = json.loads(text, parse_constant=refuse)
    return entries


def test_every_hand_has_its_entry_and_the_numbers_agree_with_each_other(
    hand: HandModel, tmp_path: Path
) -> None:
    write_results(tmp_path, [fitted(hand)], hand.faces, ResultOptions(meshes=0, pictures=0))
    entries = read(tmp_path)
    assert [entry["name"] for entry in entries] == ["a b.jpg", "b/c.png", "third"]
    assert [entry["side"] for entry in entries] == list(SIDES)
    for entry in entries[:2]:
        shapes = {
            key: np.shape(entry[key])
            for key in ("landmarks_3d", "landmarks_2d", "sigma_2d", "shape")
        }
        assert shapes == {
            "landmarks_3d": (21, 3), "landmarks_2d": (21, 2), "sigma_2d": (21, 2), "shape": (10,),
        }  # fmt: skip
        assert list(entry["joint_angles_degrees"]) == list(ARTICULATED)
        points, camera = np.array(entry["landmarks_3d"]), np.array(entry["camera"]["intrinsics"])
        np.testing.assert_allclose(camera, CAMERA, atol=1e-3)
        on_plane = points / points[:, 2:] @ camera.T
        np.testing.assert_allclose(on_plane[:, :2], entry["landmarks_2d"], atol=0.02)
        assert entry["camera"]["source"] == "given"
        assert entry["residual"] < 0.02
        assert entry["loss"]["pose"] == 0.0
    assert not (tmp_path / "meshes").exists()
    assert not (tmp_path / "pictures").exists()


def test_a_hand_that_was_not_seen_keeps_its_place_with_nulls(
    hand: HandModel, tmp_path: Path
) -> None:
    write_results(tmp_path, [fitted(hand)], hand.faces, SMALL_RESULTS)
    last = read(tmp_path)[2]
    assert last["verdict"] == "not fitted"
    assert last["reasons"]
    told = {"image", "name", "side", "verdict", "reasons", "source", "hand_model", "version"}
    assert all(value is None for key, value in last.items() if key not in told)


def test_hands_that_were_left_out_of_the_fit_come_back_in_their_places(hand: HandModel) -> None:
    whole = fitted(hand)
    seen = dataclasses.replace(
        whole.observed,
        labelled=whole.observed.labelled[[2, 0, 1]],
        landmarks_2d=whole.observed.landmarks_2d[[2, 0, 1]],
        left=whole.observed.left[[2, 0, 1]],
    )
    usable = seen.select(seen.usable)
    crops = to_crops(usable)
    found = HandPrediction(
        HandParameters(
            torch.zeros(2, 15, 3), torch.zeros(2, 10), torch.eye(3).repeat(2, 1, 1), torch.zeros(2, 3)
        ),
        torch.ones(2, 5, 3), torch.ones(2, 16, 3), torch.ones(2, 21, 3),
        crops.batch.landmarks_2d.nan_to_num(50.0), torch.zeros(2, 21, 2), torch.eye(3).repeat(2, 1, 1),
    )  # fmt: skip
    back = fitted_hands(seen, to_crops(seen), found, {"data": torch.tensor([1.0, 2.0])})
    alone = fitted_hands(usable, crops, found, {"data": torch.tensor([1.0, 2.0])})
    assert back.fitted.tolist() == [False, True, True]
    assert back.prediction.vertices[0].isnan().all()
    assert torch.equal(back.prediction.vertices[1:], alone.prediction.vertices)
    assert torch.equal(back.prediction.landmarks_2d[1:], alone.prediction.landmarks_2d)
    assert back.loss["data"][1:].tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="1 predictions for 3 hands, 2 of them usable"):
        fitted_hands(seen, to_crops(seen), found.select(slice(1)), {})


def test_a_part_without_a_usable_hand_is_written_as_nulls(hand: HandModel, tmp_path: Path) -> None:
    observed = fitted(hand).observed.select(slice(2, 3))
    nothing = HandPrediction(
        HandParameters(
            torch.zeros(0, 15, 3), torch.zeros(0, 10), torch.zeros(0, 3, 3), torch.zeros(0, 3)
        ),
        torch.zeros(0, 5, 3), torch.zeros(0, 16, 3), torch.zeros(0, 21, 3), torch.zeros(0, 21, 2),
        torch.zeros(0, 21, 2), torch.zeros(0, 3, 3),
    )  # fmt: skip
    part = fitted_hands(observed, to_crops(observed), nothing, {})
    assert write_results(tmp_path, [part], hand.faces) == {
        "hands": 1, "fitted": 0, "doubtful": 0, "left": 0
    }  # fmt: skip
    assert [entry["verdict"] for entry in read(tmp_path)] == ["not fitted"]


def test_a_hand_whose_fit_ran_away_is_not_fitted(hand: HandModel, tmp_path: Path) -> None:
    good = fitted(hand)
    points = good.prediction.landmarks_3d.clone()
    points[1, 3, 2] = torch.inf
    bad = dataclasses.replace(
        good, prediction=dataclasses.replace(good.prediction, landmarks_3d=points)
    )
    summary = write_results(tmp_path, [bad], hand.faces, SMALL_RESULTS)
    fits = [entry["verdict"] != "not fitted" for entry in read(tmp_path)]
    assert fits == [True, False, False]
    assert summary["fitted"] == 1


def test_angles_are_degrees_by_joint_and_axis(hand: HandModel, tmp_path: Path) -> None:
    part = fitted(hand)
    write_results(tmp_path, [part], hand.faces, SMALL_RESULTS)
    written = read(tmp_path)[0]["joint_angles_degrees"]
    radians = float(part.prediction.parameters.joint_angles[0, ARTICULATED.index("ring PIP"), 0])
    assert written["ring PIP"]["bend"] == pytest.approx(math.degrees(radians), abs=1e-3)
    assert all(list(angles) == list(AXES) for angles in written.values())


def test_tables_hold_the_numbers_of_the_file_of_hands(hand: HandModel, tmp_path: Path) -> None:
    write_results(tmp_path, [fitted(hand)], hand.faces, SMALL_RESULTS)
    entries = read(tmp_path)
    with (tmp_path / "hands.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["name"] for row in rows] == [entry["name"] for entry in entries]
    assert [row["verdict"] for row in rows] == [entry["verdict"] for entry in entries]
    for row, entry in zip(rows[:2], entries, strict=False):
        assert float(row["residual_px"]) == entry["residual"]
        bend = entry["joint_angles_degrees"]["ring PIP"]["bend"]
        assert float(row["ring_PIP_bend_degrees"]) == bend
        assert [float(row[f"{axis}_m"]) for axis in "xyz"] == entry["landmarks_3d"][0]
        assert float(row["focal_px"]) == pytest.approx(700, abs=1e-2)
    # A hand that is not fitted has empty cells, not zeros.
    assert {rows[2][key] for key in ("residual_px", "z_m", "shape_0", "camera")} == {""}
    with (tmp_path / "landmarks.csv").open(encoding="utf-8", newline="") as stream:
        points = list(csv.DictReader(stream))
    assert [row["landmark"] for row in points[:21]] == list(LANDMARKS)
    assert len(points) == 3 * 21
    for position in (0, 7, 20):
        row, entry = points[21 + position], entries[1]
        assert [float(row["u_px"]), float(row["v_px"])] == entry["landmarks_2d"][position]
        assert float(row["sigma_u_px"]) == entry["sigma_2d"][position][0]
        assert [float(row[f"{axis}_m"]) for axis in "xyz"] == entry["landmarks_3d"][position]
    assert points[5]["observed_u_px"] == ""


def test_an_unknown_camera_and_an_unknown_sigma_are_said_to_be(
    hand: HandModel, tmp_path: Path
) -> None:
    part = dataclasses.replace(fitted(hand, calibrated=False), has_sigma=False)
    write_results(tmp_path, [part], hand.faces, SMALL_RESULTS)
    entry = read(tmp_path)[0]
    assert entry["camera"]["source"] == "assumed"
    assert entry["sigma_2d"] is None


def test_parts_are_one_list_and_the_summary_is_of_all_of_them(
    hand: HandModel, tmp_path: Path
) -> None:
    parts = (fitted(hand, off=off) for off in (0.0, 0.01))
    summary = write_results(tmp_path, parts, hand.faces, SMALL_RESULTS)
    assert len(read(tmp_path)) == 6
    assert (summary["hands"], summary["fitted"], summary["left"]) == (6, 4, 2)
    # 20 and 21 landmarks are labelled, twice; 1 cm at half a metre is some 14 px at f = 700.
    assert summary["landmarks"] == 82
    assert 4.0 < summary["residual"] < 9.0
    assert summary["residual_224"] != summary["residual"]
    assert summary["loss/data"] == 2.0


def test_a_residual_is_the_mean_distance_in_pixels(hand: HandModel, tmp_path: Path) -> None:
    part = fitted(hand)
    moved = part.prediction.landmarks_2d + torch.tensor([3.0, -4.0])
    part = dataclasses.replace(
        part, prediction=dataclasses.replace(part.prediction, landmarks_2d=moved)
    )
    summary = write_results(tmp_path, [part], hand.faces, SMALL_RESULTS)
    assert summary["residual"] == pytest.approx(5.0, abs=0.02)
    assert read(tmp_path)[0]["residual"] == pytest.approx(5.0, abs=0.02)
    scales = part.scale[:2].double()
    expected = float((5.0 * scales * torch.tensor([20, 21])).sum() / 41)
    assert summary["residual_224"] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_meshes_are_in_metres_and_face_outwards_on_either_hand(
    hand: HandModel, tmp_path: Path, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    part = fitted(hand)
    options = dataclasses.replace(SMALL_RESULTS, mesh_format=kind, pictures=0)
    with caplog.at_level(logging.INFO):
        write_results(tmp_path, [part], hand.faces, options)
    assert "meshes of the first 2 hands only, 1 are left out; raise meshes for more" in caplog.text
    files = sorted((tmp_path / "meshes").iterdir())
    assert [file.name for file in files] == [f"000000_a-b.{kind}", f"000001_b-c.{kind}"]
    for number, file in enumerate(files):
        mesh = trimesh.load_mesh(file, process=False)
        np.testing.assert_allclose(mesh.vertices, part.prediction.vertices[number], atol=1e-6)
        # Triangles that face outwards enclose a positive volume, in spite of the open wrist.
        assert mesh.volume > 1e-5


def test_nothing_is_overwritten(hand: HandModel, tmp_path: Path) -> None:
    assert claim_results_folder(tmp_path / "run") == tmp_path / "run"
    assert claim_results_folder(tmp_path / "run") == tmp_path / "run"
    write_results(tmp_path / "run", [fitted(hand)], hand.faces, SMALL_RESULTS)
    before = (tmp_path / "run" / "hands.json").read_text()
    taken = r"already holds hands\.json, hands\.csv, landmarks\.csv, fits\.png, meshes, pictures of"
    with pytest.raises(FileExistsError, match=taken):
        write_results(tmp_path / "run", [fitted(hand)], hand.faces, SMALL_RESULTS)
    assert (tmp_path / "run" / "hands.json").read_text() == before


def test_what_was_fitted_before_an_error_is_kept_under_another_name(
    hand: HandModel, tmp_path: Path
) -> None:
    def parts() -> Any:  # noqa: ANN401
        yield fitted(hand)
        raise RuntimeError("out of memory")

    with pytest.raises(RuntimeError, match="out of memory"):
        write_results(tmp_path, parts(), hand.faces, SMALL_RESULTS)
    assert not (tmp_path / "hands.json").exists()
    assert len(json.loads((tmp_path / "hands.json.part").read_text())) == 3


def test_hands_json_can_be_fitted_to_again(hand: HandModel, tmp_path: Path) -> None:
    part = fitted(hand, off=0.01)  # The projections are some 14 px off.
    write_results(tmp_path, [part], hand.faces, SMALL_RESULTS)
    again = read_landmarks(tmp_path / "hands.json")
    assert again.names == part.observed.names
    assert torch.equal(again.left, part.observed.left)
    assert again.usable.tolist() == [True, True, False]
    assert torch.equal(again.labelled, part.observed.labelled)
    torch.testing.assert_close(
        again.landmarks_2d[again.labelled],
        part.observed.landmarks_2d[part.observed.labelled],
        rtol=0,
        atol=1e-3,
    )


def test_no_hands_are_an_empty_list(hand: HandModel, tmp_path: Path) -> None:
    assert write_results(tmp_path, [], hand.faces)["hands"] == 0
    assert read(tmp_path) == []


def test_an_unknown_format_of_meshes_is_refused() -> None:
    with pytest.raises(
        ValueError, match=r"Unknown format of meshes 'stl'; choose one of \['obj', 'ply', 'glb'\]"
    ):
        ResultOptions(mesh_format="stl")
