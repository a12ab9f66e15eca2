"""Hands of other systems' files, as an audit reads them."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from hand_recon.evaluation.scores import HandPoints
from hand_recon.fitting.hands_file import writing_hands
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import landmark_permutation
from hand_recon.plausibility.given_hands import GivenHands, of_points
from hand_recon.plausibility.joint_orders import to_landmarks
from hand_recon.plausibility.posed_hands import HandModels, posed_hands
from hand_recon.plausibility.repaired_hands import repaired, to_records
from hand_recon.protocols.benchmarks import PROTOCOLS
from hand_recon.protocols.submission import write_submission
from hand_recon.runs.audit.sources import Reading, read_given
from tests.support.audited_hands import MIRROR, audit_of, natural_angles, points_of

COUNT = 6


@pytest.fixture(scope="module")
def points(hand: HandModel) -> torch.Tensor:
    return points_of(hand, natural_angles(COUNT))


def read(hand: HandModel, *paths: Path, **settings: bool) -> GivenHands:
    return read_given(paths, hand, None, Reading(**settings))


def test_lists_of_points_as_freihand_has_them(
    hand: HandModel, points: torch.Tensor, tmp_path: Path
) -> None:
    (tmp_path / "training_xyz.json").write_text(json.dumps(points.tolist()))
    found = read(hand, tmp_path)
    assert torch.allclose(found.points, points, atol=1e-6)
    assert found.left == (None,) * COUNT
    assert not found.exact.any()


@pytest.mark.parametrize("protocol", ["freihand", "ho3d_v3"])
def test_predictions_of_a_benchmark_packed_or_not(
    hand: HandModel, points: torch.Tensor, tmp_path: Path, protocol: str
) -> None:
    predicted = HandPoints(points.double(), points.repeat(1, 38, 1)[:, :778])
    paths = write_submission(PROTOCOLS[protocol], predicted, tmp_path)
    assert {path.suffix for path in paths} == {".json", ".zip"}
    both = read(hand, *paths)
    assert len(both) == 2 * COUNT
    assert torch.allclose(both.points[:COUNT], both.points[COUNT:])
    ours = both.points[:COUNT]
    if protocol != "freihand":
        ours = ours[:, list(landmark_permutation("ho3d", "freihand"))]
    apart = torch.cdist(ours, ours) - torch.cdist(points, points)
    # HO3D's have four decimals of a metre.
    assert float(apart.abs().max()) < 3e-4


def test_the_text_of_dexycb_in_millimetres(
    hand: HandModel, points: torch.Tensor, tmp_path: Path
) -> None:
    ids = torch.arange(COUNT) * 7
    (path,) = write_submission(PROTOCOLS["dexycb"], HandPoints(points.double()), tmp_path, ids=ids)
    found = read(hand, path)
    assert found.names == ("0", "7", "14", "21", "28", "35")
    assert torch.allclose(found.points / 1000, points, atol=1e-5)


def test_a_recording_of_a_headset_with_sides_and_names(hand: HandModel, tmp_path: Path) -> None:
    joints = np.random.default_rng(0).normal(size=(2, 25, 3)).round(3)
    rows = [
        {"names": [name], "handedness": side, "time": 5, "jointPositions": one.tolist()}
        for name, side, one in zip(("rest", "fist"), ("left", "right"), joints, strict=True)
    ]
    (tmp_path / "poses.json").write_text(json.dumps(rows))
    found = read(hand, tmp_path / "poses.json")
    assert (found.names, found.left, found.sides) == (
        ("rest", "fist"), (True, False), ("left", "right"),
    )  # fmt: skip
    assert torch.allclose(found.points, to_landmarks(torch.from_numpy(joints)).float())


def test_openxr_joints_in_arrays_and_lists(hand: HandModel, tmp_path: Path) -> None:
    joints = np.random.default_rng(1).normal(size=(3, 26, 3)).round(3)
    np.save(tmp_path / "a.npy", joints)
    (tmp_path / "b.json").write_text(json.dumps(joints.tolist()))
    np.savez(tmp_path / "c.npz", something=joints)
    found = read(hand, *(tmp_path / name for name in ("a.npy", "b.json", "c.npz")))
    expected = to_landmarks(torch.from_numpy(joints)).float()
    assert torch.allclose(found.points, expected.repeat(3, 1, 1))


@pytest.mark.parametrize("form", ["wide", "named", "numbered", "long", "bare"])
def test_tables_with_a_row_per_hand_or_per_landmark(
    hand: HandModel, points: torch.Tensor, tmp_path: Path, form: str
) -> None:
    flat, rows = points.flatten(1).tolist(), points.flatten(0, 1).tolist()
    header = ",".join(f"{axis}{i}" for i in range(21) for axis in "xyz")
    lines = {
        "wide": [header, *(",".join(map(str, row)) for row in flat)],
        "named": [f"name,{header}", *(f"hand{i}," + ",".join(map(str, row)) for i, row in enumerate(flat))],
        "numbered": [f"{i}," + ",".join(map(str, row)) for i, row in enumerate(flat)],
        "long": ["hand,landmark,x_m,y_m,z_m", *(f"{i},p,{x},{y},{z}" for i, (x, y, z) in enumerate(rows))],
        "bare": [f"{x},{y},{z}" for x, y, z in rows],
    }[form]  # fmt: skip
    (tmp_path / "hands.csv").write_text("\n".join(lines) + "\n")
    assert torch.allclose(read(hand, tmp_path / "hands.csv").points, points, atol=1e-6)


def test_a_table_of_another_width_is_refused(hand: HandModel, tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("1,2,3,4\n5,6,7,8\n")
    with pytest.raises(
        ValueError, match="has 4 columns in 2 rows; expected a row per hand with 63"
    ):
        read(hand, tmp_path / "x.csv")


def test_our_own_files_give_angles_sides_and_cameras(
    hand: HandModel, points: torch.Tensor, tmp_path: Path
) -> None:
    points = points.clone()
    points[0] *= MIRROR
    given = of_points(points, "points", left=[True] + [False] * (COUNT - 1))
    hands = repaired(audit_of(given, hand), HandModels.of(hand))
    records = to_records(hands, "0")
    with writing_hands(tmp_path / "hands.json") as write:
        write(records)
    # Tables of the same hands are not read again.
    (tmp_path / "landmarks.csv").write_text("x,y,z")
    found = read(hand, tmp_path)
    assert found.left == given.left
    assert found.exact.all()
    expected = hands.after.hands
    assert (
        float((found.parameters.joint_angles - expected.parameters.joint_angles).abs().max()) < 1e-5
    )
    posed = posed_hands(found, HandModels.of(hand))
    apart = torch.cdist(posed.landmarks, posed.landmarks) - torch.cdist(
        expected.landmarks, expected.landmarks
    )
    assert float(apart.abs().max()) < 1e-4
    in_file = torch.from_numpy(records.landmarks_3d).float()
    # The pose of a left hand, mirrored, is where the file has it.
    assert float((posed.landmarks[0] * MIRROR - in_file[0]).abs().max()) < 1e-4
    assert {camera.source for camera in found.cameras if camera is not None} == {"none"}


def test_dexycbs_labels_mark_missing_hands_with_minus_one(
    hand: HandModel, points: torch.Tensor, tmp_path: Path
) -> None:
    zeros = np.zeros((1, 51), dtype=np.float32)
    np.savez(tmp_path / "labels_000000.npz", joint_3d=points[:1].numpy(), pose_m=zeros)
    np.savez(tmp_path / "labels_000001.npz", joint_3d=np.full((1, 21, 3), -1.0), pose_m=zeros)
    found = read(hand, tmp_path)
    assert torch.allclose(found.points[0], points[0])
    assert found.points[1].isnan().all()


def test_an_annotation_of_ho3d_is_read_without_unpickling(
    hand: HandModel, points: torch.Tensor, tmp_path: Path
) -> None:
    order = list(landmark_permutation("freihand", "ho3d"))
    folder = tmp_path / "ABF10" / "meta"
    folder.mkdir(parents=True)
    content = {
        "handJoints3D": points[0, order].numpy(),
        "handPose": np.zeros(48),
        "handBeta": np.zeros(10),
    }
    (folder / "0000.pkl").write_bytes(pickle.dumps(content))
    found = read(hand, tmp_path)
    assert found.names == ("ABF10/0000",)
    assert torch.allclose(found.points[0], points[0])


class Harmful:
    def __reduce__(self) -> tuple[object, ...]:
        return (print, ("run",))


def test_pickles_are_refused_in_every_wrapping(
    hand: HandModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    objects = np.array([Harmful()], dtype=object)
    np.savez(tmp_path / "a.npz", joint_3d=objects)
    np.save(tmp_path / "b.npy", objects)
    (tmp_path / "c.pth").write_bytes(pickle.dumps(Harmful()))
    (tmp_path / "d.pkl").write_bytes(pickle.dumps(Harmful()))
    for name, words in (
        ("a.npz", "joint_3d is not an array of numbers"),
        ("b.npy", "Arrays of objects are pickles, which may run"),
        ("c.pth", "is a pickle, which may run code"),
        ("d.pkl", "print"),
    ):
        with pytest.raises(ValueError, match=words):
            read(hand, tmp_path / name)
    assert "run" not in capsys.readouterr().out


def test_what_is_missing_or_unknown_is_named(hand: HandModel, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No file of hands at .*nothing\.json"):
        read(hand, tmp_path / "nothing.json")
    with pytest.raises(
        FileNotFoundError, match=r"holds no file of hands; expected one with \.json"
    ):
        read(hand, tmp_path)
    (tmp_path / "a.obj").write_text("1")
    with pytest.raises(ValueError, match=r"has the suffix \.obj; expected one of"):
        read(hand, tmp_path / "a.obj")
    np.savez(tmp_path / "a.npz", vertices=np.zeros((2, 778, 3)), more=np.zeros(3))
    with pytest.raises(ValueError, match="holds more, vertices; expected 3D landmarks"):
        read(hand, tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", hand_pose=np.zeros((2, 15, 3, 3)), betas=np.zeros((2, 10)))
    with pytest.raises(ValueError, match=r"holds MANO's parameters .* Give hand=mano"):
        read(hand, tmp_path / "b.npz")
    (tmp_path / "c.json").write_text('[{"pose": 1}]')
    with pytest.raises(
        ValueError, match="hand 0 has the keys pose; expected one of jointPositions"
    ):
        read(hand, tmp_path / "c.json")


def test_frames_of_tracks_are_sequences(hand: HandModel, tmp_path: Path) -> None:
    tracks = np.random.default_rng(2).normal(size=(2, 5, 21, 3))
    np.savez(tmp_path / "world.npz", keypoints_3d=tracks, is_right=np.array([[0] * 5, [1] * 5]))
    found = read(hand, tmp_path / "world.npz")
    assert found.sides == ("left",) * 5 + ("right",) * 5
    assert found.names[7] == "1.2"
    assert len(set(found.sequences)) == 2
    assert found.times[5:].tolist() == pytest.approx([i / 30 for i in range(5)])


def test_a_file_as_one_sequence_or_one_person(
    hand: HandModel, points: torch.Tensor, tmp_path: Path
) -> None:
    np.save(tmp_path / "a.npy", points.numpy())
    sequence = read(hand, tmp_path, sequence=True)
    assert sequence.times.tolist() == pytest.approx([i / 30 for i in range(COUNT)])
    person = read(hand, tmp_path, same_person=True)
    assert person.times.isnan().all()
    assert set(person.sequences) == set(sequence.sequences) == {str(tmp_path / "a.npy")}


@pytest.mark.parametrize("name", ["a.npy", "a.npz"])
def test_empty_and_damaged_arrays_are_named(hand: HandModel, tmp_path: Path, name: str) -> None:
    for content in (b"", b"PK\x03\x04junk")[: 1 if name == "a.npy" else 2]:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(
            ValueError, match=rf"{name} is empty or damaged .*; expected arrays of NumPy"
        ):
            read(hand, tmp_path / name)


def test_objects_with_frames_with_missing_hands_and_short_sides(
    hand: HandModel, points: torch.Tensor, tmp_path: Path
) -> None:
    rows = [
        {"name": "clip", "side": "L", "landmarks": points[:2].tolist()},
        {"side": "R", "landmarks": points[2].tolist()},
        {"landmarks": None},
    ]
    (tmp_path / "a.json").write_text(json.dumps(rows))
    found = read(hand, tmp_path)
    assert found.names == ("clip.0", "clip.1", "1", "2")
    assert found.left == (True, True, False, None)
    assert torch.allclose(found.points[:3], points[:3], atol=1e-6)
    assert found.points[3].isnan().all()


def test_tracks_have_the_rate_that_was_given(hand: HandModel, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.random.default_rng(2).normal(size=(1, 4, 21, 3)))
    found = read_given([tmp_path], hand, None, Reading(fps=60.0))
    assert found.times.tolist() == pytest.approx([i / 60 for i in range(4)])


def test_both_hands_of_a_person_are_two_sequences(
    hand: HandModel, points: torch.Tensor, tmp_path: Path
) -> None:
    rows = [
        {"side": ("left", "right")[i % 2], "landmarks": one}
        for i, one in enumerate(points[:4].tolist())
    ]
    (tmp_path / "a.json").write_text(json.dumps(rows))
    found = read(hand, tmp_path, sequence=True)
    assert found.sequences[::2] == (f"{tmp_path / 'a.json'} left",) * 2
    assert found.sequences[1::2] == (f"{tmp_path / 'a.json'} right",) * 2
    assert found.times.tolist() == pytest.approx([0, 0, 1 / 30, 1 / 30])


def test_2d_landmarks_are_sent_to_the_fit(hand: HandModel, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps([{"landmarks": [None, *[[3.0, 4.0]] * 20]}]))
    with pytest.raises(ValueError, match=r"2D landmarks; expected 3D ones\. Fit them first"):
        read(hand, tmp_path)
