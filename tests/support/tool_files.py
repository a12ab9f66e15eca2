"""The same three hands, one left and two right, in the files of all tools that are read."""

import json
import struct
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tests.support.annotation_files import (
    MEDIAPIPE_NAMES,
    SIDES,
    SIZE,
    cvat_coco,
    cvat_images,
    cvat_video,
    deeplabcut,
    flat,
    label_studio_short,
    label_studio_task,
    labelme,
    named_columns,
    yolo_labels,
)
from tests.support.landmark_writing import POINTS, SCORES


@dataclass(frozen=True)
class ToolFile:
    """A file of the three hands."""

    tool: str
    content: str | bytes
    has_sides: bool = True
    has_scores: bool = False
    in_shares: bool = False
    name: str = "landmarks.json"


def people() -> list[dict[str, Any]]:
    """The left and the first right hand as one person's, the other right hand as another's."""
    empty = [0] * 63
    return [
        {
            "person_id": [-1], "pose_keypoints_2d": [1.0] * 75, "face_keypoints_2d": [],
            "hand_left_keypoints_2d": flat(0), "hand_right_keypoints_2d": flat(1),
        },
        {
            "person_id": [-1], "pose_keypoints_2d": [0] * 75, "face_keypoints_2d": [],
            "hand_left_keypoints_2d": empty, "hand_right_keypoints_2d": flat(2),
        },
    ]  # fmt: skip


def bodies(keypoints: int, first: int) -> np.ndarray:
    """Two bodies of so many keypoints with scores, the hands at their place; the second has no left hand."""
    made = np.zeros((2, keypoints, 3))
    made[:, :17] = 7.0, 8.0, 0.5
    for body, hand in ((0, 0), (0, 1), (1, 2)):
        start = first + 21 * (hand > 0)
        made[body, start : start + 21] = np.reshape(flat(hand), (21, 3))
    return made


def mmpose_instances() -> list[dict[str, Any]]:
    return [
        {
            "keypoints": POINTS[hand].tolist(), "keypoint_scores": SCORES[hand].tolist(),
            "bbox": [[0, 0, 9, 9]], "bbox_score": 1.0, "label": f"{SIDES[hand]}_hand",
        }
        for hand in range(3)
    ]  # fmt: skip


def mmpose_bodies() -> list[dict[str, Any]]:
    return [
        {"keypoints": body[:, :2].tolist(), "keypoint_scores": body[:, 2].tolist()}
        for body in bodies(133, 91)
    ]


def mediapipe(index_of_right: int | None, spelling: str = "categoryName") -> dict[str, Any]:
    """A result of the hand landmarker; the index of the category `Right` as a version writes it."""
    categories = []
    for side in SIDES:
        category: dict[str, Any] = {spelling: side.capitalize(), "score": 0.98}
        if index_of_right is not None:
            category["index"] = index_of_right if side == "right" else 1 - index_of_right
        categories.append([category])
    return {
        "handedness": categories,
        "landmarks": [normalised(hand) for hand in range(3)],
        "worldLandmarks": [[{"x": 0.0, "y": 0.01, "z": 0.02}] * 21] * 3,
    }


def normalised(hand: int) -> list[dict[str, float]]:
    """Landmarks as MediaPipe has them: shares of the image's size, and a depth."""
    return [
        {"x": u / SIZE[0], "y": v / SIZE[1], "z": -0.02, "visibility": 0.0, "presence": 0.0}
        for u, v in POINTS[hand].tolist()
    ]


def pose_file(version: float = 0.2, dimensions: int = 3) -> bytes:
    """A file of pose-format: two frames of one person with a left and a right hand and a body's point."""

    def string(text: str) -> bytes:
        return struct.pack("<H", len(text)) + text.encode()

    form = "XYZC" if dimensions == 3 else "XYC"
    parts = [
        ("POSE_LANDMARKS", ["NOSE"]),
        *((f"{side}_HAND_LANDMARKS", MEDIAPIPE_NAMES) for side in ("LEFT", "RIGHT")),
    ]
    header = struct.pack("<fHHHH", version, *SIZE, 0, len(parts))
    for name, points in parts:
        header += string(name) + string(form) + struct.pack("<HHH", len(points), 1, 1)
        header += b"".join(map(string, points)) + struct.pack("<HHHHH", 0, 0, 255, 0, 0)
    coordinates = np.zeros((2, 1, 43, dimensions), dtype="<f4")
    coordinates[0, 0, 1:, :2] = POINTS[:2].reshape(42, 2)
    coordinates[1, 0, 22:, :2] = POINTS[2]
    found = np.zeros((2, 1, 43), dtype="<f4")
    found[0, 0, :] = 1
    found[1, 0, 22:] = 1
    counts = struct.pack("<HHH", 25, 2, 1) if version < 0.15 else struct.pack("<fIH", 25.0, 2, 1)
    return header + counts + coordinates.tobytes() + found.tobytes()


def _file(tool: str, content: object, **about: Any) -> ToolFile:  # noqa: ANN401
    return ToolFile(
        tool, content if isinstance(content, str | bytes) else json.dumps(content), **about
    )


def _files() -> dict[str, ToolFile]:
    instances = mmpose_instances()
    halpe = [{"image_id": "a.jpg", "keypoints": body.ravel().tolist()} for body in bodies(136, 94)]
    lines = "\n".join(json.dumps(_one_hand(hand)) for hand in range(3))
    frames = [
        {"frame_id": 3, "instances": instances[:2]},
        {"frame_id": 4, "instances": instances[2:]},
    ]
    openpose_lines = "\n".join(
        json.dumps({"version": 1.3, "people": [person]}) for person in people()
    )
    whole = {"has_scores": True}
    no_sides = {"has_sides": False}
    shares = {"in_shares": True}
    table = {"name": "landmarks.csv"}
    return {
        "openpose": _file("OpenPose", {"version": 1.3, "people": people()}, **whole),
        "openpose lines": _file("OpenPose", openpose_lines, **whole),
        "mmpose image": _file("mmpose", instances, **whole),
        "mmpose nested": _file("mmpose", [instances], **whole),
        "mmpose predictions": _file("mmpose", {"predictions": [instances]}, **whole),
        "mmpose frames": _file("mmpose", frames, **whole),
        "mmpose instance_info": _file("mmpose", {"meta_info": {}, "instance_info": frames}, **whole),
        "mmpose bodies": _file("mmpose", mmpose_bodies(), **whole),
        "halpe": _file("COCO", halpe, **whole),
        "body lists": _file("lists of hands", bodies(133, 91).tolist(), **whole),
        "tasks": _file("MediaPipe", mediapipe(0), **shares),
        "tasks in python": _file(
            "MediaPipe",
            {("hand_" + k if k == "landmarks" else k): v for k, v in mediapipe(0, "category_name").items()},
            **shares,
        ),
        "tasks without index": _file("MediaPipe", mediapipe(None), **shares),
        "tasks lines": _file("MediaPipe", lines, **shares),
        "holistic": _file("MediaPipe", _holistic(), **shares),
        "tensorflow.js": _file("MediaPipe", _tensorflow_js()),
        "ultralytics": _file("Ultralytics", _ultralytics(), **whole),
        "labelme": _file("LabelMe", labelme()),
        "label studio": _file("Label Studio", [label_studio_task(hand) for hand in range(3)]),
        "label studio min": _file("Label Studio", [label_studio_short(hand) for hand in range(3)]),
        "cvat": _file("CVAT", cvat_images(), name="annotations.xml"),
        "cvat video": _file("CVAT", cvat_video(), name="annotations.xml"),
        "cvat coco": _file("COCO", cvat_coco()),
        "deeplabcut": _file("DeepLabCut", deeplabcut(), **table, **whole),
        "named columns": _file("named landmarks", named_columns(), **table, **whole),
        "pose 0.2": _file(".pose", pose_file(0.2), name="a.pose"),
        "pose 0.1": _file(".pose", pose_file(0.1, 2), name="a.pose"),
        "yolo": _file("YOLO's labels", yolo_labels(3), name="a.txt", **no_sides, **shares),
        "yolo pairs": _file("YOLO's labels", yolo_labels(2), name="a.txt", **no_sides, **shares),
        "frames": _file("lists of hands", [POINTS[:2].tolist(), [], POINTS[2:].tolist()], **no_sides),
    }  # fmt: skip


def _one_hand(hand: int) -> dict[str, Any]:
    whole = mediapipe(0)
    return {
        "timestamp": 40 * hand,
        "landmarks": [whole["landmarks"][hand]],
        "handedness": [whole["handedness"][hand]],
    }


def _holistic() -> list[dict[str, Any]]:
    return [
        {"left_hand_landmarks": normalised(0), "right_hand_landmarks": normalised(1)},
        {"left_hand_landmarks": [], "right_hand_landmarks": normalised(2)},
    ]


def _ultralytics() -> list[dict[str, Any]]:
    return [
        {
            "name": f"{SIDES[hand]}_hand", "class": 0, "confidence": 0.9,
            "keypoints": {
                "x": POINTS[hand, :, 0].tolist(), "y": POINTS[hand, :, 1].tolist(),
                "visible": SCORES[hand].tolist(),
            },
        }
        for hand in range(3)
    ]  # fmt: skip


def _tensorflow_js() -> list[dict[str, Any]]:
    return [
        {
            "score": 0.9, "handedness": SIDES[hand].capitalize(),
            "keypoints": [
                {"x": u, "y": v, "name": name.lower()}
                for (u, v), name in zip(POINTS[hand].tolist(), MEDIAPIPE_NAMES, strict=True)
            ],
        }
        for hand in range(3)
    ]  # fmt: skip


FILES: Final = _files()
"""Files of all tools by the name of the form."""

JSON_FILES: Final[dict[str, str]] = {
    name: file.content
    for name, file in FILES.items()
    if isinstance(file.content, str) and "lines" not in name and file.name.endswith(".json")
}
"""The files that are one JSON value."""
