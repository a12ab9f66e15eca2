import shutil
from pathlib import Path

import pytest

from hand_recon.inspection.datasets import look_at_datasets, look_at_mano
from hand_recon.inspection.finding import Finding
from tests.support.freihand_folder import write_folder
from tests.support.mano_file import write_mano_folder, write_mano_pickle


def named(findings: list[Finding], subject: str) -> Finding:
    (finding,) = [one for one in findings if one.subject == subject]
    return finding


def test_mano_is_absent_waiting_or_ready(tmp_path: Path) -> None:
    absent = look_at_mano(tmp_path)
    assert {one.state for one in absent} == {"absent"}
    assert all("prepare mano" in one.cure for one in absent)
    write_mano_pickle(tmp_path / "MANO_RIGHT.pkl")
    waiting = named(look_at_mano(tmp_path), "MANO right")
    assert waiting.state == "absent"
    assert waiting.cure == f"python -m hand_recon.prepare mano {tmp_path / 'MANO_RIGHT.pkl'}"
    write_mano_folder(tmp_path)
    assert {one.state for one in look_at_mano(tmp_path)} == {"good"}


def test_a_file_that_is_no_hand_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "MANO_RIGHT.safetensors").write_bytes(b"something else")
    found = named(look_at_mano(tmp_path), "MANO right")
    assert found.state == "wrong"
    assert "prepare mano" in found.found


def test_nothing_is_found_where_nothing_is(tmp_path: Path) -> None:
    findings = look_at_datasets(tmp_path / "nowhere")
    assert [(one.subject, one.state) for one in findings] == [
        ("FreiHAND", "absent"), ("DexYCB", "absent"), ("HO3D", "absent"),
    ]  # fmt: skip


def test_freihand_is_counted(tmp_path: Path) -> None:
    root = write_folder(tmp_path / "deep" / "FreiHAND_pub_v2", hands=5).root
    found = named(look_at_datasets(tmp_path), "FreiHAND training")
    assert found.state == "absent"
    assert found.found.splitlines() == [
        f"20 of 130,240 images, lists K xyz scale; {root}",
        "A set of your own, or FreiHAND_pub_v2.zip was not unpacked completely",
    ]
    assert found.cure == f"python -m hand_recon.prepare check data=freihand data.root={root}"


def test_freihand_with_more_images_than_there_are_or_with_none_is_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = write_folder(tmp_path / "FreiHAND_pub_v2", hands=5).root
    wanted = {"training": (16, "a.zip"), "evaluation": (3, "b.zip")}
    monkeypatch.setattr("hand_recon.inspection.datasets.FREIHAND", wanted)
    assert named(look_at_datasets(tmp_path), "FreiHAND training").state == "wrong"
    shutil.rmtree(root / "training")
    found = named(look_at_datasets(tmp_path), "FreiHAND training")
    assert found.state == "wrong"
    assert found.cure == "Unpack a.zip again: all images are in it."


def test_a_whole_freihand_is_good(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = write_folder(tmp_path / "FreiHAND_pub_v2", hands=5).root
    write_folder(tmp_path / "FreiHAND_pub_v2", hands=3, versions=1, part="evaluation")
    wanted = {"training": (20, "a.zip"), "evaluation": (3, "b.zip")}
    monkeypatch.setattr("hand_recon.inspection.datasets.FREIHAND", wanted)
    for part in ("training", "evaluation"):
        found = named(look_at_datasets(tmp_path), f"FreiHAND {part}")
        assert found.state == "good"
        assert found.cure == f"python -m hand_recon.prepare check data=freihand data.root={root}"


def test_ho3d_is_told_by_its_lists(tmp_path: Path) -> None:
    root = tmp_path / "HO3D_v2"
    root.mkdir()
    (root / "train.txt").write_text("ABF10/0000\nABF10/0001\n")
    (root / "evaluation.txt").write_text("SM1/0000\n\n")
    found = named(look_at_datasets(tmp_path), "HO3D")
    assert found.state == "absent"
    assert found.found.startswith(
        "v2: 2 of 66,034 training and 1 of 11,524 evaluation frames, without"
    )
    assert found.cure == (
        f"python -m hand_recon.prepare check data=ho3d data.root={root} data.version=v2"
    )
    (root / "evaluation.txt").write_text("SM1/0000\n" * 11_525)
    assert named(look_at_datasets(tmp_path), "HO3D").state == "wrong"


def test_dexycb_is_counted_by_subject(tmp_path: Path) -> None:
    root = tmp_path / "DexYCB"
    for subject, recordings in (("20200709-subject-01", 100), ("20200813-subject-02", 99)):
        for recording in range(recordings):
            (root / subject / f"2020_{recording}").mkdir(parents=True)
    (root / "calibration").mkdir()
    # 99 recordings cannot be split.
    broken = named(look_at_datasets(tmp_path), "DexYCB")
    assert broken.state == "wrong"
    assert broken.found.startswith("2 of 10 subjects, 199 of 1,000 recordings")
    assert broken.cure.endswith("other than 100 recordings: 20200813-subject-02.")
    (root / "20200813-subject-02" / "2020_99").mkdir()
    partial = named(look_at_datasets(tmp_path), "DexYCB")
    assert partial.state == "absent"
    assert partial.found.splitlines()[1].startswith("Without 20200820-subject-03, 20200903-subject")
    assert partial.cure == (
        f"python -m hand_recon.prepare check data=dexycb data.root={root} data.partial=true"
    )
