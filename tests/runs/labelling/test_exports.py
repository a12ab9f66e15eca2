"""Exports for CVAT and Label Studio: read back whole, and with what a person changed in them."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit
from xml.etree.ElementTree import Element, parse

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.hand.skeleton import LANDMARK_PARENTS, LANDMARKS
from hand_recon.runs.labelling.cvat_export import ANNOTATIONS, TASK, write_cvat
from hand_recon.runs.labelling.label_records import LabelledImage
from hand_recon.runs.labelling.label_studio_export import INTERFACE, TASKS, write_label_studio
from tests.support.labelled_hands import SIZE, image, labelled

NAMES = ("b/10 & 2.jpg", 'ä #1? 50% "x".png', "b/c/+a;b.jpg")
THUMB_TIP = LANDMARKS.index("thumb tip")


@pytest.fixture
def images() -> list[LabelledImage]:
    """An image of two right hands, one of a doubtful left hand, one without hands, one of a right hand."""
    return [
        image(NAMES[0], labelled(0), labelled(1)),
        image(NAMES[1], labelled(2, "left", doubtful=True)),
        image("none.jpg"),
        image(NAMES[2], labelled(3)),
    ]


Write = Callable[[Path, list[LabelledImage]], Path]


def cvat(folder: Path, images: list[LabelledImage]) -> Path:
    return write_cvat(folder, images)[0]


def label_studio(folder: Path, images: list[LabelledImage]) -> Path:
    return write_label_studio(folder, images, folder / "my photos")[0]


def read_back(path: Path) -> ImageLandmarks:
    return read_landmarks(path, assumed=Assumptions(side=None, images=path.parent / "my photos"))


def with_files(folder: Path) -> None:
    """Empty files with the names of the images: names are looked up on the disk."""
    for name in NAMES:
        (folder / "my photos" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "my photos" / name).touch()


@pytest.mark.parametrize("write", [cvat, label_studio])
def test_all_hands_come_back_in_order_with_their_sides_and_images(
    write: Write, images: list[LabelledImage], tmp_path: Path
) -> None:
    with_files(tmp_path)
    found = read_back(write(tmp_path, images))
    pairs = [(one, hand) for one in images for hand in one.hands]
    assert len(found) == len(pairs) == 4
    for number, (one, hand) in enumerate(pairs):
        points = found.landmarks_2d[number].numpy()
        # CVAT has hundredths of a pixel, Label Studio 1e-4 percent of 400.
        np.testing.assert_allclose(points, hand.landmarks_2d, atol=3e-4)
        assert bool(found.left[number]) == (hand.side == "left")
        assert found.images[number] == tmp_path / "my photos" / one.name
    assert found.image_sizes is not None
    assert found.image_sizes.tolist() == [list(SIZE)] * 4


@pytest.mark.parametrize("write", [cvat, label_studio])
def test_a_missing_landmark_stays_missing(write: Write, tmp_path: Path) -> None:
    hand = labelled(1)
    hand.landmarks_2d[THUMB_TIP] = np.nan
    found = read_back(write(tmp_path, [image("a.jpg", hand)]))
    assert (~found.labelled).nonzero().tolist() == [[0, THUMB_TIP]]


def test_a_point_outside_of_the_image_is_missing_in_label_studio_alone(tmp_path: Path) -> None:
    """Label Studio's validator refuses percents below 0 and above 100."""
    hand = labelled(1)
    hand.landmarks_2d[3], hand.landmarks_2d[7] = (-0.5, 20), (20, SIZE[1] + 0.5)
    hand.landmarks_2d[5] = SIZE
    in_cvat = read_back(cvat(tmp_path, [image("a.jpg", hand)]))
    np.testing.assert_allclose(in_cvat.landmarks_2d[0].numpy(), hand.landmarks_2d)
    found = read_back(label_studio(tmp_path, [image("a.jpg", hand)]))
    assert (~found.labelled[0]).nonzero()[:, 0].tolist() == [3, 7]


def points_of(root: Element, skeleton: int) -> list[Element]:
    return root.findall(".//skeleton")[skeleton].findall("points")


def test_changes_in_cvat_come_back(images: list[LabelledImage], tmp_path: Path) -> None:
    path = cvat(tmp_path, images)
    tree = parse(path)  # noqa: S314  # our own file
    root = tree.getroot()
    moved, deleted = points_of(root, 0)[THUMB_TIP], points_of(root, 1)[7]
    moved.set("points", "12.50,99.25")
    deleted.set("outside", "1")
    attributes = root.findall(".//skeleton")[3].findall("attribute")
    (side,) = [one for one in attributes if one.get("name") == "side"]
    assert side.text == "right"
    side.text = "left"
    tree.write(path)
    found = read_back(path)
    assert found.landmarks_2d[0, THUMB_TIP].tolist() == [12.5, 99.25]
    assert (~found.labelled).nonzero().tolist() == [[1, 7]]
    assert found.left.tolist() == [False, False, True, True]


def test_changes_in_label_studio_come_back(images: list[LabelledImage], tmp_path: Path) -> None:
    """An export after correction: annotations made from the predictions, which stay beside them."""
    path = label_studio(tmp_path, images)
    tasks: list[dict[str, Any]] = json.loads(path.read_text())
    for number, task in enumerate(tasks):
        task["id"] = number
        task["annotations"] = [json.loads(json.dumps(task["predictions"][0]))]
    regions = [task["annotations"][0]["result"] for task in tasks]
    value(regions[0], "hand0", "thumb tip").update(x=25.0, y=50.0)
    regions[0].remove(region(regions[0], "hand1", "index DIP"))
    for one in regions[2]:
        labels = one["value"].get("keypointlabels", [])
        labels[:] = [label.replace("right", "left") for label in labels]
    path.write_text(json.dumps(tasks))
    found = read_back(path)
    assert found.landmarks_2d[0, THUMB_TIP].tolist() == [0.25 * SIZE[0], 0.5 * SIZE[1]]
    assert (~found.labelled).nonzero().tolist() == [[1, LANDMARKS.index("index DIP")]]
    assert found.left.tolist() == [False, False, True, True]


def region(regions: list[dict[str, Any]], hand: str, landmark: str) -> dict[str, Any]:
    (found,) = [
        one
        for one in regions
        if one.get("parentID") == hand and one["value"]["keypointlabels"][0].endswith(landmark)
    ]
    return found


def value(regions: list[dict[str, Any]], hand: str, landmark: str) -> dict[str, Any]:
    found: dict[str, Any] = region(regions, hand, landmark)["value"]
    return found


def test_cvats_file_has_what_its_importer_asks_of_skeletons(
    images: list[LabelledImage], tmp_path: Path
) -> None:
    """CVAT looks up id and name of an image, and label, occluded, outside and points of a point."""
    root = parse(cvat(tmp_path, images)).getroot()  # noqa: S314  # our own file
    assert root.tag == "annotations"
    assert root.findtext("version") == "1.1"
    assert [one.get("name") for one in root.findall("image")] == list(NAMES)
    assert [one.get("id") for one in root.findall("image")] == ["0", "1", "2"]
    labels = root.findall("./meta/task/labels/label")
    assert [one.findtext("name") for one in labels] == ["hand", *LANDMARKS]
    assert [one.findtext("parent") for one in labels] == [None] + ["hand"] * 21
    assert [one.findtext("type") for one in labels] == ["skeleton"] + ["points"] * 21
    for skeleton in root.findall(".//skeleton"):
        points = skeleton.findall("points")
        assert [point.get("label") for point in points] == list(LANDMARKS)
        assert all({"occluded", "outside", "points"} <= set(point.attrib) for point in points)
        # Attributes before a point would be taken for the point's.
        assert [one.tag for one in skeleton] == ["points"] * 21 + ["attribute"] * 2
    doubts = [
        one.text for one in root.findall(".//attribute") if one.get("name") == "doubt" and one.text
    ]
    assert doubts == ["low score; uncertain landmarks"]


def test_cvats_labels_fit_its_annotations(images: list[LabelledImage], tmp_path: Path) -> None:
    cvat(tmp_path, images)
    (skeleton,) = json.loads((tmp_path / TASK).read_text())
    text = (tmp_path / ANNOTATIONS).read_text(encoding="utf-8")
    assert f'skeleton label="{skeleton["name"]}"' in text
    assert [one["name"] for one in skeleton["sublabels"]] == list(LANDMARKS)
    assert {one["name"] for one in skeleton["attributes"]} == {"side", "doubt"}
    (side,) = [one for one in skeleton["attributes"] if one["name"] == "side"]
    assert sorted(side["values"]) == ["left", "right"]
    svg = skeleton["svg"]
    nodes = re.findall(r'data-node-id="(\d+)" data-label-name="([^"]+)"', svg)
    assert nodes == [(str(number), name) for number, name in enumerate(LANDMARKS, start=1)]
    edges = re.findall(r'data-node-from="(\d+)" data-node-to="(\d+)"', svg)
    assert [(int(a) - 1, int(b) - 1) for a, b in edges] == [
        (parent, child) for child, parent in enumerate(LANDMARK_PARENTS) if parent >= 0
    ]
    places = [float(number) for number in re.findall(r' c[xy]="([\d.]+)"', svg)]
    assert len(places) == 42
    assert all(0 < place < 100 for place in places)


def test_label_studios_interface_has_every_label_of_the_tasks(
    images: list[LabelledImage], tmp_path: Path
) -> None:
    tasks = json.loads(label_studio(tmp_path, images).read_text())
    view = parse(tmp_path / INTERFACE).getroot()  # noqa: S314  # our own file
    controls = {one.get("name"): one for one in view if one.get("toName") == "image"}
    known = {name: {label.get("value") for label in control} for name, control in controls.items()}
    for task in tasks:
        prediction = task["predictions"][0]
        assert 0 <= prediction["score"] <= 1
        for one in prediction["result"]:
            assert one["to_name"] == "image"
            control = controls[one["from_name"]]
            assert control.tag.lower() == one["type"]
            assert set(one["value"][one["type"]]) <= known[one["from_name"]]
        ids = [one["id"] for one in prediction["result"]]
        assert len(set(ids)) == len(ids)
        assert {one["parentID"] for one in prediction["result"] if "parentID" in one} <= set(ids)
    assert [task["data"]["doubt"] for task in tasks] == ["", "low score; uncertain landmarks", ""]


def test_label_studios_addresses_name_the_images_below_the_folder(
    images: list[LabelledImage], tmp_path: Path
) -> None:
    tasks = json.loads(label_studio(tmp_path, images).read_text())
    served = [parse_qs(urlsplit(task["data"]["image"]).query)["d"][0] for task in tasks]
    assert served == [f"my photos/{name}" for name in NAMES]


def test_the_rectangle_of_a_hand_is_its_box_with_a_margin_inside_the_image(tmp_path: Path) -> None:
    hand = labelled(5)
    hand.landmarks_2d[0], hand.landmarks_2d[1] = (100, 0.5), (300, 100)
    hand.landmarks_2d[2:] = (200, 50)
    tasks = json.loads(label_studio(tmp_path, [image("a.jpg", hand)]).read_text())
    box = tasks[0]["predictions"][0]["result"][0]["value"]
    # The extent is 200: margins of 20 px, but for the top edge.
    assert (box["x"], box["y"]) == (20.0, 0.0)
    assert (box["width"], box["height"]) == (60.0, 40.0)
    assert (tmp_path / TASKS).is_file()
