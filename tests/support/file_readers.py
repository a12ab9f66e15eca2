"""Every reader of text and arrays from elsewhere, with a small valid file for each."""

import csv
import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

import numpy as np
import yaml

from hand_recon.data.freihand.files import open_part
from hand_recon.data.landmarks.camera_files import read_camera_file
from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.hint import read_hint
from hand_recon.detection.box_files import BoxFile
from hand_recon.fitting.hands_file import hand_entries, read_hands
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.protocols.benchmarks import protocol_named
from hand_recon.protocols.prediction_files import read_ground_truth, read_pair, read_predictions
from hand_recon.runs.audit.sources import Reading, read_given
from hand_recon.tables.runs import LeftOut, read_run
from tests.support.annotation_files import SIZE
from tests.support.broken_files import Kind
from tests.support.fitted_hands import fitted
from tests.support.landmark_writing import CAMERA, POINTS
from tests.support.shard_readers import SHARD_READERS
from tests.support.tool_files import FILES

STEM: Final = "hände 手 1"
"""Beginning of all names: a space, a letter of Latin-1 and one beyond."""


@dataclass(frozen=True)
class FileReader:
    """A reader with a valid file."""

    name: str
    """Name of the format."""
    kind: Kind
    """Kind of the content."""
    place: str
    """Path of the file below a folder."""
    content: Callable[[], bytes]
    """Function that makes a valid file."""
    read: Callable[[Path], object]
    """Function that reads the file, or all that belongs to it."""
    beside: Callable[[Path], object] = lambda file: None
    """Function that writes what else belongs to a file."""


def _json(value: object) -> Callable[[], bytes]:
    return lambda: json.dumps(value).encode()


def _npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def _npz(name: str, array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **{name: array})
    return stream.getvalue()


def _table(rows: list[list[object]]) -> bytes:
    stream = io.StringIO()
    csv.writer(stream).writerows(rows)
    return stream.getvalue().encode()


POINTS_3D: Final = np.random.default_rng(5).normal(size=(3, 21, 3)).round(4) * 0.05 + [0, 0, 0.5]
"""Three hands of random points before a camera, metres."""


@cache
def _hands() -> list[dict[str, object]]:
    return list(hand_entries(to_records(fitted(open_hand()))))


def _landmarks() -> list[FileReader]:
    rows: list[list[object]] = [[f"{axis}{n}" for n in range(21) for axis in "uv"]]
    rows += [list(hand.ravel()) for hand in POINTS]
    forms = (
        "openpose", "tasks lines", "cvat", "deeplabcut", "named columns", "yolo", "label studio", "cvat coco",
        "frames",
    )  # fmt: skip
    suffixes: dict[str, tuple[Kind, str]] = {
        "annotations.xml": ("xml", ".xml"), "landmarks.csv": ("csv", ".csv"), "a.txt": ("text", ".txt"),
    }  # fmt: skip

    def read(path: Path) -> object:
        return read_landmarks(path, image_size=SIZE)

    def of_tool(name: str) -> FileReader:
        file = FILES[name]
        kind, suffix = suffixes.get(file.name, ("lines" if "lines" in name else "json", ".json"))
        content = file.content.encode() if isinstance(file.content, str) else file.content
        return FileReader(f"landmarks, {name}", kind, STEM + suffix, lambda: content, read)

    pose = FILES["pose 0.2"].content
    return [
        FileReader("landmarks", "json", f"{STEM}.json", _json(POINTS.tolist()), read),
        FileReader("landmarks, table", "csv", f"{STEM}.csv", lambda: _table(rows), read),
        FileReader("landmarks, npy", "binary", f"{STEM}.npy", lambda: _npy(POINTS), read),
        FileReader("landmarks, pose", "binary", f"{STEM}.pose", lambda: bytes(pose), read),  # type: ignore[arg-type]
        *map(of_tool, forms),
        FileReader(
            "HInt", "json", f"{STEM}_l.json",
            _json([{"bbox": [[1.5, 2.5, 90.5, 80.5]], "keypoints": POINTS[0].tolist(),
                    "occlusion": [0.0] * 21}]),
            lambda path: read_hint(path.parent),
            lambda path: path.with_suffix(".jpg").write_bytes(b""),
        ),
    ]  # fmt: skip


_OPENCV_XML: Final = """<?xml version="1.0"?>
<opencv_storage><camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>900.5 0.0 640.5 0.0 905.5 480.5 0.0 0.0 1.0</data></camera_matrix></opencv_storage>"""


def _cameras() -> list[FileReader]:
    text = "\n".join(" ".join(map(str, row)) for row in CAMERA)
    colmap = "1 PINHOLE 1280 960 900.5 905.5 640.5 480.5"

    def reader(name: str, kind: Kind, suffix: str, content: bytes) -> FileReader:
        return FileReader(
            f"camera, {name}", kind, STEM + suffix, lambda: content,
            lambda path: read_camera_file(path, None),
        )  # fmt: skip

    return [
        reader("JSON", "json", ".json", json.dumps({"K": CAMERA}).encode()),
        reader("YAML", "yaml", ".yaml", yaml.safe_dump({"camera_matrix": CAMERA}).encode()),
        reader("XML", "xml", ".xml", _OPENCV_XML.encode()),
        reader("text", "text", ".txt", text.encode()),
        reader("COLMAP", "text", ".txt", colmap.encode()),
        reader("npy", "binary", ".npy", _npy(np.array(CAMERA))),
    ]


def _boxes_and_hands() -> list[FileReader]:
    boxes = {"a.jpg": [[1.5, 2.5, 90.5, 80.5]]}
    table: list[list[object]] = [
        ["image", "left", "top", "right", "bottom"],
        ["a.jpg", 1.5, 2.5, 9.5, 8.5],
    ]

    def lines() -> bytes:
        return "\n".join(json.dumps(one) for one in _hands()).encode()

    return [
        FileReader("boxes", "json", f"{STEM}.json", _json(boxes), BoxFile),
        FileReader("boxes, table", "csv", f"{STEM}.csv", lambda: _table(table), BoxFile),
        FileReader(
            "hands", "json", f"{STEM}.json", lambda: json.dumps(_hands()).encode(), read_hands
        ),
        FileReader("hands, lines", "lines", f"{STEM}.jsonl", lines, read_hands),
    ]


def _ranges() -> FileReader:
    @cache
    def content() -> bytes:
        table = files("hand_recon.knowledge") / "tables" / "literature.yaml"
        parsed = yaml.safe_load(table.read_text(encoding="utf-8"))
        for row in parsed["joints"].values():
            for bounds in row.values():
                bounds[:2] = map(float, bounds[:2])
        return yaml.safe_dump(parsed, default_flow_style=None, width=200).encode()

    return FileReader(
        "ranges", "yaml", f"{STEM}.yaml", content, lambda path: load_ranges(str(path))
    )


def _predictions() -> list[FileReader]:
    freihand, dexycb = protocol_named("freihand"), protocol_named("dexycb")
    lists = json.dumps([POINTS_3D.tolist(), []]).encode()
    text = "\n".join(
        ",".join(map(str, [float(row), *hand.ravel()])) for row, hand in enumerate(1000 * POINTS_3D)
    ).encode()

    def truth(path: Path) -> Path:
        file = path.parent / "truth" / "evaluation_xyz.json"
        file.parent.mkdir()
        file.write_text(json.dumps(POINTS_3D.tolist()))
        return file

    return [
        FileReader(
            "predictions", "json", f"{STEM}.json", lambda: lists,
            lambda path: read_pair(path, path.parent / "truth", freihand), truth,
        ),
        FileReader(
            "predictions, text", "csv", f"{STEM}.txt", lambda: text,
            lambda path: read_pair(path, path.parent / "truth", dexycb), truth,
        ),
        FileReader(
            "predictions, zip", "binary", f"{STEM}.zip", lambda: zipped("pred.json", lists),
            lambda path: read_predictions(path, freihand),
        ),
        FileReader(
            "ground truth", "json", f"{STEM}/evaluation_xyz.json", _json(POINTS_3D.tolist()),
            lambda path: read_ground_truth(path.parent, freihand),
        ),
        FileReader(
            "FreiHAND", "json", f"{STEM}/training_xyz.json", _json(POINTS_3D.tolist()),
            lambda path: open_part(path.parent, "training", None), _freihand,
        ),
    ]  # fmt: skip


def _freihand(path: Path) -> None:
    """Images without content, which are only counted here, and camera matrices."""
    images = path.parent / "training" / "rgb"
    images.mkdir(parents=True)
    for number in range(3):
        (images / f"{number:08d}.jpg").touch()
    (path.parent / "training_K.json").write_text(json.dumps([CAMERA] * 3))


def zipped(name: str, content: bytes) -> bytes:
    """Zip archive of one file."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    return stream.getvalue()


def _audited() -> list[FileReader]:
    hand = cache(open_hand)

    def read(path: Path) -> object:
        return read_given([path], hand(), None, Reading())

    rows: list[list[object]] = [[f"{axis}{n}" for n in range(21) for axis in "xyz"]]
    rows += [list(hand.ravel()) for hand in POINTS_3D]
    recorded = [{"name": "a", "landmarks_3d": hand.tolist()} for hand in POINTS_3D]
    return [
        FileReader("audit, npy", "binary", f"{STEM}.npy", lambda: _npy(POINTS_3D), read),
        FileReader(
            "audit, npz", "binary", f"{STEM}.npz", lambda: _npz("landmarks_3d", POINTS_3D), read
        ),
        FileReader("audit, table", "csv", f"{STEM}.csv", lambda: _table(rows), read),
        FileReader("audit, records", "json", f"{STEM}.json", _json(recorded), read),
        FileReader("audit, lists", "json", f"{STEM}.json", _json(POINTS_3D[0].tolist()), read),
    ]


def _runs() -> list[FileReader]:
    metrics = {"test": {"E_J": 10.5, "E_V": 11.5}, "name": "a"}
    settings = {"name": "a", "seed": 1, "prior": {"shape": 10.5, "pose": 2.5}}

    def read(path: Path) -> object:
        found = read_run(path.parent)
        if isinstance(found, LeftOut):
            raise ValueError(f"{found.folder}/{path.name}: {found.reason}")
        return found

    def metrics_beside(path: Path) -> None:
        (path.parent / "metrics.json").write_text(json.dumps(metrics))

    def all_beside(path: Path) -> None:
        metrics_beside(path)
        (path.parent / "config.yaml").write_text(yaml.safe_dump(settings))

    rows: list[list[object]] = [["index", "E_J", "E_V"]]
    rows += [[row, 10.5, 9.5] for row in range(6)]
    table = _table(rows)
    return [
        FileReader(
            "metrics", "json", f"{STEM}/metrics.json", _json({**metrics, "seed": 1}), read
        ),
        FileReader(
            "settings", "yaml", f"{STEM}/config.yaml", lambda: yaml.safe_dump(settings).encode(), read,
            metrics_beside,
        ),
        FileReader("errors", "csv", f"{STEM}/per_hand.csv", lambda: table, read, all_beside),
    ]  # fmt: skip


READERS: Final[dict[str, FileReader]] = {
    one.name: one
    for one in (
        *_landmarks(), *_cameras(), *_boxes_and_hands(), _ranges(), *_predictions(), *_audited(), *_runs(),
        *(FileReader(*one) for one in SHARD_READERS),
    )
}  # fmt: skip
"""Readers of text and arrays by name."""
