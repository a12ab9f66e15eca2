import contextlib
import io
import json
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from hand_recon.evaluation.scores import HandPoints
from hand_recon.protocols import prediction_files, prediction_json
from hand_recon.protocols.benchmarks import PROTOCOLS
from hand_recon.protocols.prediction_files import read_ground_truth, read_pair, read_predictions
from hand_recon.protocols.prediction_json import read_point_list, read_point_lists
from tests.support.json_parsers import parser
from tests.support.predicted_hands import write_ground_truth

FREIHAND, DEXYCB = PROTOCOLS["freihand"], PROTOCOLS["dexycb"]


both_parsers = pytest.mark.usefixtures(parser.__name__)


def points(frames: int = 4, count: int = 21) -> np.ndarray:
    return np.random.default_rng(count).normal(size=(frames, count, 3))


def pred(*lists: np.ndarray | list[object], indent: int | None = None) -> str:
    return json.dumps([np.asarray(some).tolist() for some in lists], indent=indent)


@both_parsers
@pytest.mark.parametrize("indent", [None, 1])
@pytest.mark.parametrize("chunk", [1 << 24, 1000, 1001, 1002, 1003])
def test_reads_what_json_reads_wherever_a_chunk_ends(
    indent: int | None, chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prediction_json, "CHUNK", chunk)
    monkeypatch.setattr(prediction_json, "HEAD", min(chunk * 3, 1 << 20))
    landmarks, vertices = points(), points(count=30)
    text = "\n " + pred(landmarks, vertices, indent=indent) + "\n"
    lists = read_point_lists(io.BytesIO(text.encode()), "pred.json")
    np.testing.assert_array_equal(lists.landmarks, landmarks)
    assert lists.vertices is not None
    np.testing.assert_array_equal(lists.vertices, vertices.astype(np.float32))


@pytest.mark.parametrize("second", [[], [[], [], [], []]])
def test_an_empty_list_of_vertices_is_none(second: list[object]) -> None:
    text = json.dumps([points().tolist(), second])
    assert read_point_lists(io.BytesIO(text.encode()), "p").vertices is None


MISTAKES = {
    "deep lists": ("[[[[1" + 100_000 * ",[2" + "]]", r"something else than points"),
    "a number as a point": ("[[[[1,2,3],5,[1,2,3]],[", r"something else than points"),
    "more after landmarks": (pred(points()) + "  \n [", r"after its end follows"),
    "verts first": (pred(points(count=778), points()), r"778 points and not 21; this seems to be the mesh"),
    "two hands": (pred(points(count=42), points()), r"42 points and not 21; those of one hand"),
    "no wrist": (pred(points(count=20), points()), r"20 points and not 21; one is missing"),
    "no tips": (pred(points(count=16), points()), r"add the five tips"),
    "a dictionary": (json.dumps({"xyz": points().tolist()}), r"holds a dictionary"),
    "dictionaries": (json.dumps([{"xyz": points().tolist()}]), r"list of dictionaries"),
    "flat frames": (json.dumps(points().reshape(4, 63).tolist()), r"2 lists deep"),
    "confidences": (json.dumps([np.ones((4, 21, 4)).tolist(), []]), r"4 numbers and not 3"),
    "strings": (json.dumps([points().astype(str).tolist(), []]), r"must not be in quotes"),
    "null": (pred(points(), points()).replace("0.", "null", 1), r"contains 'null': it is no number"),
    "cut off": (pred(points(), points())[:3000], r"cut off within the landmarks"),
    "cut off later": (pred(points(), points(count=90))[:-9], r"cut off"),
    "no text": ("", r"it is empty"),
    "no JSON": ("id,x,y,z", r"no JSON list"),
    "more after it": (pred(points(), points()) + "[1]", r"brackets|no frames|not a number"),
    "fewer meshes": (pred(points(), points(3, 30)), r"4 frames of landmarks and 3 frames of vert"),
    "a short frame": (
        json.dumps([[*points().tolist(), points(1, 20)[0].tolist()], []]),
        r"some frame has other points",
    ),
}  # fmt: skip


@both_parsers
@pytest.mark.parametrize("name", MISTAKES)
def test_anything_else_is_refused_with_what_was_found(name: str, tmp_path: Path) -> None:
    text, message = MISTAKES[name]
    (tmp_path / "pred.json").write_text(text)
    with pytest.raises(ValueError, match=rf"pred\.json is no file of predictions: .*({message})"):
        read_predictions(tmp_path / "pred.json", FREIHAND)


def test_landmarks_alone_are_read_with_a_remark(tmp_path: Path) -> None:
    (tmp_path / "pred.json").write_text(json.dumps(points().tolist()))
    file = read_predictions(tmp_path / "pred.json", FREIHAND)
    np.testing.assert_array_equal(file.points.landmarks.numpy(), points())
    assert "landmarks alone" in file.remarks[0]


@pytest.mark.parametrize("name", ["pred.json", "results/pred.json"])
def test_a_zip_is_read_and_a_folder_in_it_remarked(tmp_path: Path, name: str) -> None:
    with zipfile.ZipFile(tmp_path / "pred.zip", "w") as archive:
        archive.writestr(name, pred(points(), points(count=778)))
    file = read_predictions(tmp_path / "pred.zip", FREIHAND)
    np.testing.assert_array_equal(file.points.landmarks.numpy(), points())
    assert [("top level" in remark) for remark in file.remarks] == [True] * (name != "pred.json")


def test_a_zip_without_predictions_is_refused_with_its_contents(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "pred.zip", "w") as archive:
        archive.writestr("scores.txt", "1")
    with pytest.raises(ValueError, match=r"holds scores.txt and no pred.json"):
        read_predictions(tmp_path / "pred.zip", FREIHAND)


def ground_truth_and(tmp_path: Path, text: str, count: int = 30) -> tuple[Path, Path]:
    ground_truth = HandPoints(torch.from_numpy(points()), torch.from_numpy(points(count=count)))
    write_ground_truth(tmp_path / "truth", ground_truth, FREIHAND)
    (tmp_path / "pred.json").write_text(text)
    return tmp_path / "pred.json", tmp_path / "truth"


def test_another_number_of_frames_names_both(tmp_path: Path) -> None:
    paths = ground_truth_and(tmp_path, pred(points(3), points(3, 30)))
    with pytest.raises(ValueError, match=r"pred.json has 3 frames and the ground truth in .* 4"):
        read_pair(*paths, FREIHAND)


@both_parsers
def test_the_frames_that_are_not_finite_are_named(tmp_path: Path) -> None:
    landmarks = points()
    landmarks[2, 5, 1] = np.nan
    with pytest.raises(ValueError, match=r"landmarks of the samples 2 are not finite"):
        read_pair(*ground_truth_and(tmp_path, pred(landmarks, [])), FREIHAND)
    vertices = points(count=30)
    vertices[3, 5, 1] = np.inf
    with pytest.raises(ValueError, match=r"vertices of the samples 3 are not finite"):
        read_pair(*ground_truth_and(tmp_path, pred(points(), vertices)), FREIHAND)


def test_frames_of_another_number_than_the_official_one_are_remarked(tmp_path: Path) -> None:
    pair = read_pair(*ground_truth_and(tmp_path, pred(points(), points(count=30))), FREIHAND)
    assert any("4 frames are scored and not the 3960" in remark for remark in pair.remarks)
    assert pair.prediction.vertices is not None


def test_a_mesh_of_another_count_is_left_out_with_a_remark(tmp_path: Path) -> None:
    pair = read_pair(*ground_truth_and(tmp_path, pred(points(), points(count=29))), FREIHAND)
    assert pair.prediction.vertices is None
    assert pair.predicted_vertices is not None
    assert any("29 vertices and the ground truth 30" in remark for remark in pair.remarks)


def test_a_folder_without_ground_truth_says_what_is_looked_for(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"holds no evaluation_xyz.json"):
        read_ground_truth(tmp_path, FREIHAND)


def test_a_cut_list_of_vertices_is_refused() -> None:
    text = json.dumps(points().tolist())[:-2]
    with pytest.raises(ValueError, match=r"v.json is no list of frames .*cut off"):
        read_point_list(io.BytesIO(text.encode()), "v.json")


def text_of(ids: list[int], landmarks: np.ndarray) -> str:
    rows = [
        ",".join(map(repr, [i, *row]))
        for i, row in zip(ids, landmarks.reshape(-1, 63).tolist(), strict=True)
    ]
    return "\n".join(rows) + "\n"


def test_dexycb_takes_the_annotated_ids_from_any_order_and_leaves_others(tmp_path: Path) -> None:
    true = points()
    true[1] = -1
    (tmp_path / "truth.txt").write_text(text_of([5, 6, 7, 8], 1000 * true))
    (tmp_path / "mine.txt").write_text(text_of([8, 99, 7, 5], points()))
    (tmp_path / "truth.txt").write_text(
        text_of([5, 6, 7, 8], np.where(true == -1, -1.0, 1000 * true))
    )
    pair = read_pair(tmp_path / "mine.txt", tmp_path / "truth.txt", DEXYCB)
    np.testing.assert_array_equal(pair.prediction.landmarks.numpy(), points()[[3, 2, 0]])
    np.testing.assert_array_equal(pair.ground_truth.landmarks.numpy(), 1000 * true[[0, 2, 3]])


def test_dexycb_names_the_first_missing_ids(tmp_path: Path) -> None:
    (tmp_path / "evaluation_xyz.json").write_text(json.dumps(points().tolist()))
    (tmp_path / "mine.txt").write_text(text_of([0, 3], points(2)))
    with pytest.raises(ValueError, match=r"lacks 2 of the 4 .*: ids 1, 2\."):
        read_pair(tmp_path / "mine.txt", tmp_path, DEXYCB)


def test_dexycbs_ground_truth_in_a_folder_is_in_metres_and_skips_what_is_not_annotated(
    tmp_path: Path,
) -> None:
    true = points()
    true[0] = -1
    (tmp_path / "evaluation_xyz.json").write_text(json.dumps(true.tolist()))
    file = read_ground_truth(tmp_path, DEXYCB)
    assert file.ids.tolist() == [1, 2, 3]
    np.testing.assert_allclose(file.points.landmarks.numpy(), 1000 * true[1:], rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,3\n", r"Line 1 of .* has 3 comma-separated entries; expected are 64"),
        ("x" + ",1" * 63, r"an entry that is no number"),
        ("", r"is empty"),
        (2 * ("4" + ",1" * 63 + "\n"), r"2 lines for id 4"),
        ("4" + ",1" * 63 + "\n1.5" + ",1" * 63, r"has the id 1\.5; expected is a whole number"),
        ("-1" + ",1" * 63, r"has the id -1\.0"),
        ("nan" + ",1" * 63, r"has the id nan"),
        ("1e300" + ",1" * 63, r"has the id 1e\+300"),
        ("4" + ",1" * 62 + "," + 65 * "1", r"Line 1 of .* more than 64 characters"),
    ],
)
def test_other_text_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "mine.txt").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_predictions(tmp_path / "mine.txt", DEXYCB)


def spaces(path: Path, text: str, count: int = 1 << 27) -> Path:
    """An archive of a text followed by spaces, a thousand times smaller than its content."""
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("pred.json", "w") as stream,
    ):
        stream.write(text.encode())
        for _ in range(count >> 20):
            stream.write(b" " * (1 << 20))
    return path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"it is empty"),
        (pred(points())[:-2], r"cut off within the landmarks"),
        (pred(points())[:-1], r"not followed by the vertices"),
        (pred(points(), points(count=30))[:-4], r"cut off"),
        (pred(points(), points(count=30)), ""),
    ],
)
def test_an_archive_of_spaces_takes_no_memory(tmp_path: Path, text: str, message: str) -> None:
    path = spaces(tmp_path / "pred.zip", text)
    assert path.stat().st_size < 200_000
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=message) if message else contextlib.nullcontext():
            read_predictions(path, FREIHAND)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1 << 26, "the text has 128 MiB, a chunk 16"


def test_an_archive_that_would_unpack_to_more_than_is_read_is_refused_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prediction_files, "MAX_BYTES", 1 << 20)
    path = spaces(tmp_path / "pred.zip", "", (1 << 20) + (1 << 20))
    with pytest.raises(ValueError, match=r"pred.zip:pred.json would unpack to 2097152 bytes"):
        read_predictions(path, FREIHAND)


@pytest.mark.parametrize(
    ("bound", "value", "text", "message"),
    [
        ("MAX_BYTES", 9000, pred(points(), points()) + 9000 * " ", r"longer than the 9000 bytes"),
        ("MAX_LANDMARK_BYTES", 8000, pred(points(20))[:-3] + 9000 * ",1", r"take more than 8000"),
        ("MAX_NUMBERS", 300, pred(points(), points(count=90)), r"more than 300 numbers"),
        ("LONGEST", 1000, pred(points())[:-1] + ",[[[" + 9000 * "1", r"more than 1000 digits"),
    ],
)
def test_everything_that_is_kept_has_a_maximum_size(
    bound: str, value: int, text: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prediction_json, "CHUNK", 1000)
    monkeypatch.setattr(prediction_json, "HEAD", 3000)
    monkeypatch.setattr(prediction_json, bound, value)
    with pytest.raises(ValueError, match=rf"^p is no file of predictions: .*{message}"):
        read_point_lists(io.BytesIO(text.encode()), "p")


def test_whole_ids_are_read_however_they_are_written(tmp_path: Path) -> None:
    rows = [name + ",1" * 63 for name in ("7", "8.0", "9.000000000000000000e+00")]
    (tmp_path / "mine.txt").write_text("\n".join(rows))
    assert read_predictions(tmp_path / "mine.txt", DEXYCB).ids.tolist() == [7, 8, 9]
