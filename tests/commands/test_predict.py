"""`predict` from photographs to a folder of hands, with the landmarks of a file in the detector's place."""

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import jsonschema
import numpy as np
import pytest
import trimesh
from hydra.errors import InstantiationException

from hand_recon.runs.looking import photo_names
from hand_recon.runs.predict_run import predict
from tests.support.photo_folder import CAMERA, QUICK, SCHEMA, asked, read, table


def test_photographs_become_a_folder_of_hands(folder: Path) -> None:
    with pytest.raises(
        ValueError, match="1 of 4 images could not be processed, for the reasons above"
    ):
        predict(asked(folder, "results.meshes=glb"))
    out = folder / "out"
    entries = read(out)
    jsonschema.validate(entries, SCHEMA)
    assert [entry["image"] for entry in entries] == ["1 two.png"] * 2 + ["3 hånd's, [left].png"]
    assert [entry["side"] for entry in entries] == ["right", "right", "left"]
    for entry in entries:
        assert entry["source"] == "landmarks, lifter, fit"
        assert entry["camera"]["source"] == "given"
        assert entry["camera"]["image_size"] == [640, 480]
        np.testing.assert_allclose(entry["camera"]["intrinsics"], CAMERA, atol=1e-3)
        points = np.array(entry["landmarks_3d"])
        on_plane = points / points[:, 2:] @ np.array(CAMERA).T
        np.testing.assert_allclose(on_plane[:, :2], entry["landmarks_2d"], atol=0.05)
        off = np.linalg.norm(np.subtract(entry["landmarks_2d"], entry["observed_2d"]), axis=1)
        assert off.mean() == pytest.approx(entry["residual"], abs=0.01)
    images = table(out / "images.csv")
    assert [row["hands"] for row in images] == ["2", "0", "1", "0"]
    assert [bool(row["error"]) for row in images] == [False, False, False, True]
    assert [(row["width"], row["height"]) for row in images[:3]] == [("640", "480")] * 3
    assert len(table(out / "hands.csv")) == 3
    assert len(table(out / "landmarks.csv")) == 3 * 21
    overlays = sorted((out / "overlays").iterdir())
    assert [str(out / row["overlay"]) for row in images if row["overlay"]] == [
        str(o) for o in overlays
    ]
    drawn = cv2.imread(str(overlays[0]))
    assert drawn is not None
    # The photograph is at its own size on the left, and no longer grey where the hands are.
    assert drawn.shape[0] >= 480
    assert drawn.shape[1] > 640
    assert np.abs(drawn[:480, :640].astype(int) - 90).max() > 60
    scene = trimesh.load(out / "meshes" / f"{overlays[0].stem}.glb")
    assert isinstance(scene, trimesh.Scene)
    assert len(scene.geometry) == 2
    page = (out / "index.html").read_text(encoding="utf-8")
    assert "3 hånd&#x27;s, [left].png" in page or "3 hånd&#39;s, [left].png" in page
    assert "cut off" in page
    assert "http" not in page.replace("http://www.w3.org", "")
    assert not list(out.glob("*.part"))
    assert not (out / "unfinished.json").exists()


def test_results_are_not_overwritten(folder: Path) -> None:
    (folder / "photos" / "4 cut off.png").unlink()
    assert predict(asked(folder))["hands"] == 3
    before = (folder / "out" / "hands.json").read_bytes()
    with pytest.raises(
        FileExistsError, match=r"already holds hands\.json.* nothing is overwritten"
    ):
        predict(asked(folder))
    assert (folder / "out" / "hands.json").read_bytes() == before


def test_odd_names_and_own_drawings_in_the_input_folder(folder: Path) -> None:
    (folder / "photos" / "4 cut off.png").unlink()
    photo = folder / "photos" / "1 two.png"
    names = ["a\nb.png", "c\u2028d.png", 'e"f,g.png', os.fsdecode(b"h\xff.png")]
    for name in names:
        try:
            photo.with_name(name).write_bytes(photo.read_bytes())
        except OSError:
            names.remove(name)  # A file system that refuses the name.
    (folder / "photos" / "nowhere.png").symlink_to(folder / "gone.png")
    with pytest.raises(ValueError, match=r"1 of \d+ images could not be processed"):
        predict(asked(folder, f"output='{folder}/photos/out'"))
    rows = table(folder / "photos" / "out" / "images.csv")
    assert len(rows) == 4 + len(names)
    assert {"a\nb.png", "h\\xff.png"} & {row["image"] for row in rows}
    again = folder / "again"
    with pytest.raises(ValueError, match=r"1 of \d+ images could not be processed"):
        predict(asked(folder, f"output='{again}'"))
    assert [row["image"] for row in table(again / "images.csv")] == [row["image"] for row in rows]


def test_a_wrong_option_claims_no_folder(folder: Path) -> None:
    with pytest.raises(InstantiationException, match="Unknown format of meshes 'stl'"):
        predict(asked(folder, "results.meshes=stl"))
    assert not (folder / "out").exists()
    config = asked(folder)
    config.input = []
    with pytest.raises(ValueError, match="No image is named"):
        predict(config)


def test_strict_refuses_what_is_not_plausible_and_a_photograph_without_hands_is_no_failure(
    folder: Path,
) -> None:
    (folder / "photos" / "4 cut off.png").unlink()
    entries = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    # One finger's landmarks in the wrong order.
    entries[0]["landmarks"][5:9] = entries[0]["landmarks"][8:4:-1]
    (folder / "found.json").write_text(json.dumps(entries), encoding="utf-8")
    summary = predict(asked(folder))
    assert summary["doubtful"] >= 1
    doubtful = read(folder / "out")[0]
    assert doubtful["verdict"] == "doubtful"
    assert doubtful["reasons"]
    with pytest.raises(ValueError, match="of 3 hands are doubtful and 0 are not fitted, which"):
        predict(asked(folder, "strict=true", f"output='{folder}/strict'"))
    assert len(read(folder / "strict")) == 3


def test_no_hand_at_all_is_a_failure_that_says_what_to_try(folder: Path) -> None:
    entries = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    (folder / "found.json").write_text(json.dumps(entries[:1]), encoding="utf-8")
    photo = folder / "photos" / "2 none.png"
    with pytest.raises(ValueError, match=r"No hand was fitted in 1 image.*detector=whole"):
        predict(asked(folder, f"input=['{photo}']"))
    assert read(folder / "out") == []
    (folder / "empty").mkdir()
    with pytest.raises(ValueError, match="empty"):
        predict(asked(folder, f"input=['{folder}/empty']", f"output='{folder}/more'"))


def test_hands_on_standard_output_are_json_alone(folder: Path) -> None:
    words = [
        sys.executable, "-m", "hand_recon.predict", "photos/1 two.png", "photos/2 none.png", "--json", "-",
        "detector=landmarks", "detector.landmarks=found.json", "--camera", "fov=60", *QUICK,
    ]  # fmt: skip
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True)  # noqa: S603
    entries = json.loads(done.stdout)
    jsonschema.validate(entries, SCHEMA)
    assert [entry["camera"]["source"] for entry in entries] == ["field of view"] * 2
    assert "2 none.png" not in done.stdout
    assert not (folder / "outputs").exists()
    assert sorted(path.name for path in folder.iterdir()) == ["K.json", "found.json", "photos"]


@pytest.mark.slow
def test_a_file_that_is_no_photograph_ends_with_its_reason_and_status_1(folder: Path) -> None:
    words = [
        sys.executable, "-m", "hand_recon", "predict", "photos/4 cut off.png", "photos/1 two.png", "--output",
        "out", "detector=landmarks", "detector.landmarks=found.json", *QUICK,
    ]  # fmt: skip
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    assert done.returncode == 1
    said = done.stderr.splitlines()
    assert any(line.startswith("error: ") and "4 cut off.png" in line for line in said)
    assert any(line.startswith("error: 1 of 2 images could not be processed") for line in said)
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert len(read(folder / "out")) == 2


def test_names_of_photographs_are_file_names_unless_two_are_alike() -> None:
    assert photo_names([Path("a/x.jpg"), Path("b/y.jpg")]) == ["x.jpg", "y.jpg"]
    assert photo_names([Path("a/x.jpg"), Path("b/c/x.jpg")]) == ["a/x.jpg", "b/c/x.jpg"]
    assert photo_names([Path("a/x.jpg"), Path("a/b/x.jpg")]) == ["x.jpg", "b/x.jpg"]


def test_landmarks_of_another_folder_belong_to_the_image_that_they_name(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Two images of one name, and landmarks in a file that lies elsewhere."""
    photo = folder / "photos" / "1 two.png"
    entries = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    for number, name in enumerate(("p/a.png", "q/a.png")):
        entries[number]["image"] = name
        (folder / "lp" / name).parent.mkdir(parents=True)
        (folder / "lp" / name).write_bytes(photo.read_bytes())
    (folder / "elsewhere").mkdir()
    file = folder / "elsewhere" / "l.json"
    file.write_text(json.dumps(entries[:2]), encoding="utf-8")
    words = (f"input=['{folder}/lp']", f"detector.landmarks='{file}'")
    assert predict(asked(folder, *words))["hands"] == 2
    for entry, given in zip(read(folder / "out"), entries, strict=False):
        assert entry["image"] == given["image"]
        assert entry["score"] is None
        np.testing.assert_allclose(entry["observed_2d"], given["landmarks"], atol=1e-3)
        assert entry["camera"]["intrinsics"] == CAMERA
    # A name that could be either is an error of that image alone.
    entries[1]["image"] = "a.png"
    entries[0]["image"] = "x/a.png"
    file.write_text(
        json.dumps([*entries[:2], {**entries[1], "image": "y/a.png"}]), encoding="utf-8"
    )
    (folder / "lp" / "b.png").write_bytes(photo.read_bytes())
    with pytest.raises(ValueError, match=r"No hand was fitted|could not be processed"):
        predict(
            asked(
                folder,
                f"input=['{folder}/lp/b.png']",
                f"detector.landmarks='{file}'",
                f"output='{folder}/b'",
            )
        )
    assert "names this image" in caplog.text


def test_confidences_of_a_landmark_file_reach_the_fit(folder: Path) -> None:
    entries = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    wrong = json.loads(json.dumps(entries[:1]))
    wrong[0]["landmarks"][8][0] += 60
    off = []
    for confidence in (0.95, 0.02):
        wrong[0]["confidence"] = [0.95] * 8 + [confidence] + [0.95] * 12
        (folder / "found.json").write_text(json.dumps(wrong), encoding="utf-8")
        photo = folder / "photos" / "1 two.png"
        predict(
            asked(folder, f"input=['{photo}']", f"output='{folder}/{confidence}'", "data_term=nll")
        )
        entry = read(folder / str(confidence))[0]
        off.append(np.linalg.norm(np.subtract(entry["landmarks_2d"][8], entry["observed_2d"][8])))
    assert off[1] > off[0] + 5
