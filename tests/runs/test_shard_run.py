"""`prepare shards`: options, facts that are carried along, interruptions, and files that stay as they are."""

import json
import tarfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hand_recon.data.dataset import load_batch
from hand_recon.data.images import decode_image
from hand_recon.data.shards.encoding import Encoding
from hand_recon.data.shards.manifest import MANIFEST
from hand_recon.data.shards.writer import write_shard
from hand_recon.runs.shard_run import prepare_shards
from tests.support.shard_folders import asked, data_of, labelled_images, shards


def labels_in(folder: Path) -> list[dict[str, Any]]:
    """Labels of all images of a folder of shards, in order."""
    found = []
    for path in sorted(folder.glob("*.tar")):
        with tarfile.open(path) as archive:
            for member in archive:
                stream = archive.extractfile(member)
                if stream is not None and member.name.endswith(".json"):
                    found.append(json.load(stream))
    return found


def images_in(folder: Path) -> list[bytes]:
    """Images of a folder of shards, in order."""
    found = []
    for path in sorted(folder.glob("*.tar")):
        with tarfile.open(path) as archive:
            streams = [
                archive.extractfile(one) for one in archive if not one.name.endswith(".json")
            ]
            found += [stream.read() for stream in streams if stream is not None]
    return found


def groups_in(folder: Path) -> list[int]:
    """Group of every hand of a folder of shards, in order."""
    return [int(group) for path in sorted(folder.glob("*.npy")) for group in np.load(path)["group"]]


@pytest.fixture
def labels(tmp_path: Path) -> Path:
    return labelled_images(tmp_path / "images")


def test_images_are_their_files_byte_by_byte_and_facts_come_along(
    labels: Path, tmp_path: Path
) -> None:
    hands = json.loads(labels.read_text())
    hands[0] |= {"person": "p 1", "split": "train"}
    labels.write_text(json.dumps(hands))
    fields = tmp_path / "fields.csv"
    fields.write_text("image,person,licence\nimage1.png,p 2,\nimage0.png,,CC0-1.0\n")
    folder = shards(
        labels, tmp_path / "out", f"fields='{fields}'", "facts.source=mine", "facts.licence=own"
    )
    assert images_in(folder) == [(labels.parent / f"image{n}.png").read_bytes() for n in range(9)]
    found = labels_in(folder)
    known = [
        {key: one.get(key) for key in ("person", "split", "source", "licence")} for one in found
    ]
    assert known[0] == {"person": "p 1", "split": "train", "source": "mine", "licence": "CC0-1.0"}
    assert known[1] == {"person": "p 2", "split": None, "source": "mine", "licence": "own"}
    assert found[0]["image"] == "image0.png"
    assert [hand["side"] for hand in found[0]["hands"]] == ["left", "right"]
    assert found[0]["hands"][1]["sigma"][3] == hands[1]["sigma"][3]
    assert found[0]["hands"][0]["landmarks"][0] is None
    manifest = json.loads((folder / MANIFEST).read_text())
    assert (manifest["images"], manifest["hands"], len(manifest["shards"])) == (9, 18, 3)
    assert manifest["about"]["options"]["facts"] == {"source": "mine", "licence": "own"}


def test_scaled_images_have_scaled_labels(labels: Path, tmp_path: Path) -> None:
    folder = shards(labels, tmp_path / "out", "max_side=50", "jpeg_quality=80")
    image = decode_image(images_in(folder)[2])
    assert image is not None
    assert images_in(folder)[2].startswith(b"\xff\xd8")
    assert image.shape == (25, 50, 3)
    given = json.loads(labels.read_text())[5]
    (hand,) = (labels_in(folder)[2]["hands"][1],)
    # 200 × 100 pixels became 50 × 25: all lengths are a quarter.
    assert hand["landmarks"][7] == [value / 4 for value in given["landmarks"][7]]
    assert hand["sigma"][7] == given["sigma"][7] / 4
    files, small = (
        data_of(one).dataset("train") for one in (shards(labels, tmp_path / "a"), folder)
    )
    one, other = load_batch(files, [3]), load_batch(small, [3])
    np.testing.assert_allclose(one.landmarks_2d, other.landmarks_2d, atol=1e-4)


def test_hands_of_a_person_or_of_a_split_are_kept_together(labels: Path, tmp_path: Path) -> None:
    hands = json.loads(labels.read_text())
    for number, hand in enumerate(hands):
        hand |= {"person": f"p{number // 2 % 3}", "split": "train" if number < 8 else "test"}
    labels.write_text(json.dumps(hands))
    by_person = shards(labels, tmp_path / "a", "group_by=person")
    assert json.loads((by_person / MANIFEST).read_text())["groups"] == 3
    train = shards(labels, tmp_path / "b", "split=train")
    told = json.loads((train / MANIFEST).read_text())
    # The groups of the five images of the other split are not counted.
    assert (told["images"], told["groups"]) == (4, 4)
    assert groups_in(train) == [0, 0, 1, 1, 2, 2, 3, 3]
    test = shards(labels, tmp_path / "d", "split=test")
    assert json.loads((test / MANIFEST).read_text())["groups"] == 5
    assert sorted(set(groups_in(test))) == [0, 1, 2, 3, 4]
    with pytest.raises(ValueError, match=r"No image has the split 'val'.*\['test', 'train'\]"):
        shards(labels, tmp_path / "c", "split=val")


def test_shards_are_trained_with_the_landmark_set_that_they_were_made_with(
    labels: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shards(labels, tmp_path / "a", "landmark_set=mediapipe")
    assert f"data.train={folder} data.landmark_set=mediapipe\n" in capsys.readouterr().err
    told = r"follow the landmark set 'mediapipe', .* 'knuckle'. Set data.landmark_set=mediapipe"
    with pytest.raises(ValueError, match=told):
        data_of(folder).dataset("train")
    assert len(data_of(folder, landmark_set="mediapipe").dataset("train")) == 14
    own = shards(labels, tmp_path / "b", "landmark_set=knuckle")
    assert f"data.train={own}\n" in capsys.readouterr().err
    with pytest.raises(ValueError, match=r"'knuckle', .* 'mano'"):
        data_of(own, landmark_set="mano").dataset("val")


def test_an_interrupted_command_goes_on_and_ends_with_the_same_bytes(
    labels: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = shards(labels, tmp_path / "whole")
    written: list[str] = []

    def interrupted(folder: Path, name: str, images: Any) -> Any:  # noqa: ANN401
        if len(written) == 2:
            next(images)
            (folder / f"{name}.tar.part").write_bytes(b"half of it")
            raise KeyboardInterrupt
        written.append(name)
        return write_shard(folder, name, images)

    folder = tmp_path / "out"
    monkeypatch.setattr("hand_recon.runs.shard_run.write_shard", interrupted)
    with pytest.raises(KeyboardInterrupt):
        shards(labels, folder)
    assert not (folder / MANIFEST).exists()
    with pytest.raises(FileNotFoundError, match="goes on with the same command"):
        data_of(folder).dataset("train")
    del written[:1]
    with pytest.raises(FileExistsError, match="unfinished results of a command with other options"):
        shards(labels, folder, "max_side=100")
    shards(labels, folder)
    # The second shard counts as done, and only the third is written.
    assert written == ["shard-00001", "shard-00002"]
    names = {path.name for path in whole.iterdir()}
    assert {path.name for path in folder.iterdir()} == names
    for name in names - {"config.yaml"}:
        assert (folder / name).read_bytes() == (whole / name).read_bytes()
    with pytest.raises(FileExistsError, match=r"already holds shards.json.*nothing is overwritten"):
        shards(labels, folder)


def test_unreadable_images_are_named_and_left_out_up_to_a_limit(
    labels: Path, tmp_path: Path
) -> None:
    broken = labels.parent / "image4.png"
    broken.write_bytes(broken.read_bytes()[:100])
    (labels.parent / "image5.png").unlink()
    with pytest.raises(
        ValueError, match=r"2 images cannot be read or written.*image4.png, image5.png"
    ):
        prepare_shards(asked(labels, tmp_path / "out", "max_damaged=1"))
    told = prepare_shards(asked(labels, tmp_path / "out", "max_damaged=2"))
    assert told["damaged"] == ["image4.png", "image5.png"]
    assert (told["images"], told["hands"]) == (7, 14)
    manifest = json.loads((tmp_path / "out" / MANIFEST).read_text())
    assert manifest["about"]["unreadable"] == ["image4.png", "image5.png"]


def test_what_training_would_refuse_is_not_written(
    labels: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    # A JPEG has 65,535 pixels on a side at most.
    cv2.imwrite(str(labels.parent / "image2.png"), np.zeros((1, 70_000, 3), np.uint8))
    hands = json.loads(labels.read_text())
    hands += [hands[6]] * 1100
    labels.write_text(json.dumps(hands))
    told = prepare_shards(asked(labels, tmp_path / "out", "jpeg_quality=90"))
    assert told["damaged"] == ["image2.png", "image3.png"]
    assert "image2.png is left out: 70000 × 1 pixels cannot be encoded as JPEG" in caplog.text
    assert "image3.png is left out: the text of its 1102 labels has 1," in caplog.text
    assert len(data_of(tmp_path / "out").dataset("train")) == 2 * 5
    size = len(images_in(tmp_path / "out")[0])
    monkeypatch.setattr("hand_recon.data.shards.encoding.LARGEST_IMAGE", size - 1)
    with pytest.raises(ValueError, match=f"its JPEG has {size:,} bytes, and shards hold up to"):
        Encoding(jpeg_quality=90).read(labels.parent / "image0.png")


@pytest.mark.parametrize(
    ("option", "told"),
    [
        ("max_side=0", "max_side=0; expected pixels"), ("jpeg_quality=101", "expected 1 to 100"),
        ("group_by=film", "Unknown group_by='film'"), ("images_per_shard=0", "images_per_shard=0"),
    ],
)  # fmt: skip
def test_a_wrong_option_is_refused_before_anything_is_written(
    labels: Path, tmp_path: Path, option: str, told: str
) -> None:
    with pytest.raises(ValueError, match=told):
        shards(labels, tmp_path / "out", option)
    assert not (tmp_path / "out").exists()
