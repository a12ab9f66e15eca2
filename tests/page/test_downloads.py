"""Downloads: one file as it is, several in a zip file, read again by others."""

import csv
import io
import json
import zipfile

import pytest

from hand_recon.fitting.hand_records import HandRecords, joined_records
from hand_recon.formats.by_name import FORMATS
from hand_recon.hand.model import HandModel
from hand_recon.page.downloads import download, offered
from tests.support.exported import clip_hands, records_of


@pytest.fixture(scope="module")
def records(hand: HandModel) -> HandRecords:
    """Two hands of a clip."""
    return joined_records([records_of(one, hand) for one in clip_hands()])


def test_every_format_that_can_be_written_is_offered_and_comes(
    records: HandRecords, hand: HandModel
) -> None:
    names = [one["name"] for one in offered(hand)]
    assert names[0] == "json"
    assert "mano" not in names
    assert set(names[1:]) <= set(FORMATS)
    for name in names:
        found = download(name, records, hand, "my clip.mp4")
        assert len(found.content) > 100, name


def test_the_file_of_hands_is_one_file_with_all_hands(
    records: HandRecords, hand: HandModel
) -> None:
    found = download("json", records, hand, "clip.mp4")
    assert found.name == "hands.json"
    assert len(json.loads(found.content)) == len(records)


def test_a_file_for_each_hand_comes_as_a_zip_file(records: HandRecords, hand: HandModel) -> None:
    found = download("bvh", records, hand, "../my clip.mp4")
    assert found.name == "my-clip_bvh.zip"
    with zipfile.ZipFile(io.BytesIO(found.content)) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["clip_hand_1_left.bvh", "clip_hand_2_right.bvh"]
        assert all(archive.read(name).startswith(b"HIERARCHY") for name in archive.namelist())


def test_one_file_for_all_hands_is_not_packed(records: HandRecords, hand: HandModel) -> None:
    found = download("csv", records, hand, "clip.mp4")
    rows = list(csv.reader(io.StringIO(found.content.decode())))
    assert found.name == "angles.csv"
    assert len(rows) == 1 + len(records)


def test_an_unknown_format_is_refused(records: HandRecords, hand: HandModel) -> None:
    with pytest.raises(ValueError, match="Unknown format 'fbx'; expected one of glb"):
        download("fbx", records, hand, "clip.mp4")
