from pathlib import Path

import pytest

from hand_recon.runs.unfinished import MARK, claim_or_resume, file_state, finish

SETTINGS = {"options": {"camera": "auto", "steps": (1, 2)}, "images": [["a.jpg", 3, 5]]}


def test_a_new_folder_is_marked_until_its_results_are_complete(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "out"
    assert not claim_or_resume(folder, ["hands.json"], SETTINGS)
    (folder / "hands.json.part").write_text("[")
    assert claim_or_resume(folder, ["hands.json", "hands.json.part"], SETTINGS)
    finish(folder)
    assert not (folder / MARK).exists()
    with pytest.raises(FileExistsError, match=r"already holds hands\.json\.part, and nothing is"):
        claim_or_resume(folder, ["hands.json", "hands.json.part"], SETTINGS)


def test_a_folder_without_results_is_taken_whatever_else_it_holds(tmp_path: Path) -> None:
    (tmp_path / "photo.jpg").write_bytes(b"x")
    assert not claim_or_resume(tmp_path, ["hands.json"], SETTINGS)
    assert (tmp_path / "photo.jpg").read_bytes() == b"x"


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"options": {"camera": "exif", "steps": [1, 2]}}, "with other options, and nothing"),
        ({"images": []}, "with other images, and nothing"),
        ({"more": 1}, "with other more, and nothing"),
    ],
)
def test_unfinished_results_of_other_settings_are_not_touched(
    tmp_path: Path, changed: dict[str, object], said: str
) -> None:
    claim_or_resume(tmp_path, ["hands.json"], SETTINGS)
    before = (tmp_path / MARK).read_bytes()
    with pytest.raises(FileExistsError, match=said):
        claim_or_resume(tmp_path, ["hands.json"], SETTINGS | changed)
    assert (tmp_path / MARK).read_bytes() == before


@pytest.mark.parametrize("damaged", ["", "[1]", '{"options":'])
def test_a_damaged_mark_is_said(tmp_path: Path, damaged: str) -> None:
    (tmp_path / MARK).write_text(damaged)
    with pytest.raises(FileExistsError, match="is damaged, so that it is not known"):
        claim_or_resume(tmp_path, ["hands.json"], SETTINGS)


def test_a_changed_file_has_another_state(tmp_path: Path) -> None:
    file = tmp_path / "a.jpg"
    file.write_bytes(b"one")
    before = file_state(file)
    assert file_state(file) == before
    file.write_bytes(b"three")
    assert file_state(file) != before
