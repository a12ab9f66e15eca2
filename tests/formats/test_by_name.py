"""Formats by their names: files, refusals, and nothing that is replaced."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from hand_recon.formats.by_name import FORMATS, check, write
from hand_recon.formats.new_file import refuse_existing
from hand_recon.hand.model import HandModel
from tests.support.exported import clip, photographs

FRAMES = [0, 1, 2, 4, 5, 6, 7, 8, 9]
"""Frames of the clip with a hand."""


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("glb", ["clip.glb"]),
        ("bvh", ["clip_hand_1_left.bvh", "clip_hand_2_right.bvh"]),
        ("csv", ["angles.csv"]),
        ("obj", [f"clip_obj/{frame:06d}.obj" for frame in FRAMES]),
        ("ply", [f"clip_ply/{frame:06d}.ply" for frame in FRAMES]),
    ],
)
def test_files_of_a_clip_are_those_that_are_returned(
    hand: HandModel, tmp_path: Path, name: str, files: list[str]
) -> None:
    written = write(name, clip(hand), tmp_path / "new")
    assert [path.relative_to(tmp_path / "new").as_posix() for path in written] == files
    found = (path for path in (tmp_path / "new").rglob("*") if path.is_file())
    assert sorted(found) == sorted(written)


@pytest.mark.parametrize("name", [one.name for one in FORMATS.values() if one.hand is None])
def test_photographs_have_files_of_their_own_that_are_not_replaced(
    hand: HandModel, tmp_path: Path, name: str
) -> None:
    chosen = FORMATS[name]
    if not chosen.is_available:
        pytest.skip(f"needs {chosen.module}: pip install 'hand_recon[{chosen.extra}]'")
    written = write(name, photographs(hand), tmp_path)
    count = {"all": 1, "scene": 2, "frame": 2, "hand": 3}[chosen.holds]
    assert len(written) == len(set(written)) == count
    assert all(path.name.endswith(chosen.suffix) for path in written)
    before = {path: path.read_bytes() for path in written}
    with pytest.raises(FileExistsError, match=r"exists and is not overwritten"):
        write(name, photographs(hand), tmp_path)
    assert {path: path.read_bytes() for path in written} == before


def test_the_table_names_the_photographs_as_the_file_of_hands_has_them(
    hand: HandModel, tmp_path: Path
) -> None:
    (path,) = write("csv", photographs(hand), tmp_path)
    with path.open(encoding="utf-8", newline="") as stream:
        rows = [(row["scene"], row["image"]) for row in csv.DictReader(stream)]
    assert rows == [("two-hands", "two hands.jpg")] * 2 + [("b-far", "b/far.png")]
    (path,) = write("csv", clip(hand), tmp_path / "clip")
    with path.open(encoding="utf-8", newline="") as stream:
        assert {row["image"] for row in csv.DictReader(stream)} == {""}


def test_a_link_to_nowhere_is_not_replaced(tmp_path: Path) -> None:
    link = tmp_path / "clip.obj"
    link.symlink_to(tmp_path / "nowhere")
    with pytest.raises(FileExistsError, match=r"clip\.obj exists and is not overwritten"):
        refuse_existing([link])


def test_unknown_formats_missing_packages_and_other_hands_are_refused(
    hand: HandModel, tmp_path: Path
) -> None:
    hands = photographs(hand)
    with pytest.raises(ValueError, match=r"Unknown format 'fbx'; expected one of glb, bvh, usd"):
        write("fbx", hands, tmp_path)
    absent = replace(FORMATS["glb"], module="no_such_package", extra="nothing")
    with pytest.raises(ModuleNotFoundError, match=r"no_such_package, .* 'hand_recon\[nothing\]'"):
        check(absent, hands)
    with pytest.raises(ValueError, match=r"hand model mano; these are of open\. Make them with"):
        check(replace(FORMATS["glb"], hand="mano"), hands)
    assert not list(tmp_path.iterdir())
