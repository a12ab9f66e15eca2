"""The same three hands, one left and two right, in the files of annotation tools and in tables."""

from typing import Any, Final

import numpy as np

from hand_recon.hand.skeleton import LANDMARKS
from tests.support.landmark_writing import POINTS, SCORES, coco_hand

SIDES: Final = ("left", "right", "right")
SIZE: Final = (2000, 2000)

MEDIAPIPE_NAMES: Final = tuple(
    name.upper().replace(" ", "_FINGER_" if finger else "_").replace("LITTLE_FINGER", "PINKY")
    for number, name in enumerate(LANDMARKS)
    for finger in [number > 4]
)


def flat(hand: int) -> list[float]:
    """u, v and score of each landmark in one list."""
    numbers: list[float] = np.concatenate([POINTS[hand], SCORES[hand][:, None]], 1).ravel().tolist()
    return numbers


def labelme(hands: range = range(3)) -> dict[str, Any]:
    return {
        "version": "5.4", "flags": {}, "imagePath": "a.jpg", "imageWidth": SIZE[0], "imageHeight": SIZE[1],
        "shapes": [
            {
                "label": f"{SIDES[hand]} {name}", "points": [POINTS[hand, landmark].tolist()],
                "group_id": hand, "shape_type": "point", "flags": {},
            }
            for hand in hands for landmark, name in enumerate(LANDMARKS)
        ],
    }  # fmt: skip


def label_studio_task(hand: int) -> dict[str, Any]:
    regions = [
        {
            "original_width": SIZE[0], "original_height": SIZE[1], "image_rotation": 0, "id": f"k{landmark}",
            "type": "keypointlabels", "from_name": "kp", "to_name": "img",
            "value": {
                "x": 100 * POINTS[hand, landmark, 0] / SIZE[0],
                "y": 100 * POINTS[hand, landmark, 1] / SIZE[1],
                "width": 0.5, "keypointlabels": [f"{SIDES[hand]} {name}"],
            },
        }
        for landmark, name in enumerate(LANDMARKS)
    ]  # fmt: skip
    return {
        "id": hand,
        "data": {"image": f"/data/upload/1/{hand}.jpg"},
        "annotations": [{"id": 1, "result": regions}],
    }


def label_studio_short(hand: int) -> dict[str, Any]:
    task = label_studio_task(hand)
    regions = [
        {**region["value"], **{key: region[key] for key in ("original_width", "original_height")}}
        for region in task["annotations"][0]["result"]
    ]
    return {"id": hand, "image": task["data"]["image"], "kp": regions}


def cvat_images() -> str:
    skeletons = "".join(
        f'<image id="{hand}" name="{hand}.jpg" width="{SIZE[0]}" height="{SIZE[1]}">'
        f'<skeleton label="{SIDES[hand]} hand" source="manual" z_order="0">'
        + "".join(
            f'<points label="{landmark + 1}" source="manual" outside="0" occluded="0" '
            f'points="{u},{v}"></points>'
            for landmark, (u, v) in enumerate(POINTS[hand].tolist())
        )
        + "</skeleton></image>"
        for hand in range(3)
    )
    return f'<?xml version="1.0" encoding="utf-8"?>\n<annotations>{skeletons}</annotations>'


def cvat_video() -> str:
    tracks = "".join(
        f'<track id="{hand}" label="{SIDES[hand]} hand">'
        f'<points frame="4" outside="0" occluded="0" keyframe="1" points="'
        + ";".join(f"{u},{v}" for u, v in POINTS[hand].tolist())
        + '"></points><points frame="5" outside="1" points="1,2"></points></track>'
        for hand in range(3)
    )
    return f"<annotations><version>1.1</version>{tracks}</annotations>"


def deeplabcut() -> str:
    """A table of one frame with three individuals."""
    columns = [
        (f"{side} {number}", name, coordinate)
        for number, side in enumerate(SIDES)
        for name in LANDMARKS
        for coordinate in ("x", "y", "likelihood")
    ]
    head = [
        ["scorer", *("DLC" for _ in columns)],
        ["individuals", *(column[0] for column in columns)],
        ["bodyparts", *(column[1] for column in columns)],
        ["coords", *(column[2] for column in columns)],
    ]
    numbers = [str(number) for hand in range(3) for number in flat(hand)]
    return "\n".join(",".join(row) for row in [*head, ["7", *numbers]])


def named_columns() -> str:
    """A row per hand, with columns such as `index_finger_mcp_x`."""
    titles = [
        f"{name.lower()}_{letter}" for name in MEDIAPIPE_NAMES for letter in ("x", "y", "score")
    ]
    rows = [[SIDES[hand], *map(str, flat(hand))] for hand in range(3)]
    return "\n".join(",".join(row) for row in [["side", *titles], *rows])


def cvat_coco() -> dict[str, Any]:
    """CVAT's export of COCO keypoints, whose order is alphabetical."""
    order = sorted(range(21), key=lambda landmark: LANDMARKS[landmark].lower())
    return {
        "images": [{"id": 1, "file_name": "a.jpg", "width": SIZE[0], "height": SIZE[1]}],
        "categories": [
            {"id": 1 + hand, "name": f"{SIDES[hand]}_hand", "keypoints": [LANDMARKS[n] for n in order]}
            for hand in range(3)
        ],
        "annotations": [
            {
                "id": hand, "image_id": 1, "category_id": 1 + hand,
                "keypoints": coco_hand(POINTS[hand][order], np.full(21, 2)),
            }
            for hand in range(3)
        ],
    }  # fmt: skip


def yolo_labels(per_point: int) -> str:
    """Labels of one image with the three hands, in shares of its size."""
    shares = np.concatenate([POINTS / SIZE, np.full((3, 21, 1), 2)], axis=-1)[..., :per_point]
    return "\n".join(
        " ".join(map(str, [0, 0.5, 0.5, 0.1, 0.2, *hand.ravel().tolist()])) for hand in shares
    )
