import subprocess
import sys
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from hand_recon.runs.unfinished import MARK, claim_or_resume, file_state, finish, states_of_files

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


@pytest.mark.parametrize(
    "more", [{}, {"options": {"camera": "auto", "steps": [1, 2], "new": True}}]
)
def test_results_of_another_version_are_not_blamed_on_the_command(
    tmp_path: Path, more: dict[str, object]
) -> None:
    claim_or_resume(tmp_path, ["hands.json"], SETTINGS | {"version": "0.4.0"})
    with pytest.raises(FileExistsError) as refused:
        claim_or_resume(tmp_path, ["hands.json"], SETTINGS | {"version": "0.5.0"} | more)
    said = str(refused.value)
    assert "of version 0.4.0 of hand_recon, and this is version 0.5.0" in said
    assert "name another folder with output=…, or complete them with that version." in said
    assert "epeat that command" not in said


def test_other_options_of_one_version_may_be_new_defaults(tmp_path: Path) -> None:
    claim_or_resume(tmp_path, ["hands.json"], SETTINGS | {"version": "0.5.0"})
    changed = {"options": {"camera": "auto", "steps": [1, 2], "new": True}, "version": "0.5.0"}
    with pytest.raises(FileExistsError, match=r"other defaults\. Name another folder with output="):
        claim_or_resume(tmp_path, ["hands.json"], SETTINGS | changed)


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


@pytest.mark.slow
def test_a_folder_that_another_command_writes_to_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    claim_or_resume(tmp_path / "out", ["hands.json"], SETTINGS)
    program = (
        "import sys; from pathlib import Path; from hand_recon.runs.unfinished import claim_or_resume\n"
        "claim_or_resume(Path(sys.argv[1]), ['hands.json'], {})"
    )
    words = [sys.executable, "-c", program, str(tmp_path / "out")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603
    assert "FileExistsError: Another command is writing into" in done.stderr
    finish(tmp_path / "out")
    assert subprocess.run(words, capture_output=True, check=False).returncode == 0  # noqa: S603


def test_a_link_to_nowhere_has_a_state_and_files_that_settings_name_are_found(
    tmp_path: Path,
) -> None:
    link = tmp_path / "x.jpg"
    link.symlink_to(tmp_path / "gone.jpg")
    assert file_state(link)[1:] == [None, None]
    (tmp_path / "K.json").write_text("1")
    config = OmegaConf.create(
        {
            "camera": str(tmp_path / "K.json"),
            "detector": {"boxes": "???"},
            "lifter": None,
            "a": "auto",
        }
    )
    found = states_of_files(config, ("camera", "detector.boxes", "lifter", "a", "none.at.all"))
    assert found == {"camera": file_state(tmp_path / "K.json")}
