import importlib.metadata
import json
import subprocess
import sys
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from hand_recon.command_line.configuration_files import CONF
from hand_recon.inspection.caches import crop_maps, look_at_caches, stale_maps
from hand_recon.inspection.finding import Finding
from hand_recon.inspection.machine import look_at_disk, look_at_versions
from hand_recon.runs.diagnosis import doctor, examine, next_command
from tests.support.freihand_folder import write_folder


def configuration(folder: Path, *overrides: str) -> DictConfig:
    with initialize_config_dir(CONF, version_base="1.3"):
        return compose(
            "doctor",
            [f"folder={folder}", f"mano={folder / 'mano'}", f"paths.cache={folder / 'cache'}", "dexycb=null",
             *overrides],
        )  # fmt: skip


def test_a_bare_machine_is_told_to_make_the_first_run(tmp_path: Path) -> None:
    sections = examine(configuration(tmp_path))
    assert next_command(sections) == "python -m hand_recon.train"
    states = {one.state for found in sections.values() for one in found}
    assert states == {"good", "absent"}


def test_the_doctor_prints_json_for_programs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert doctor(configuration(tmp_path, "json=true"))
    content = json.loads(capsys.readouterr().out)
    assert content["next"] == "python -m hand_recon.train"
    assert {"subject", "state", "found", "cure"} == content["Versions"][0].keys()


def test_a_set_of_ones_own_is_not_broken_and_is_to_be_checked_next(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = write_folder(tmp_path / "own", hands=4).root
    assert doctor(configuration(tmp_path))
    printed = capsys.readouterr().out
    assert "16 of 130,240 images" in printed
    assert printed.rstrip().endswith(
        f"Next: python -m hand_recon.prepare check data=freihand data.root={root}"
    )


def test_something_broken_comes_first_and_advice_is_no_command() -> None:
    check = "python -m hand_recon.prepare check data=freihand data.root=/d"
    findings = [
        Finding("a cache", "absent", "its data are gone", "rm -r /c"),
        Finding(
            "MANO", "absent", "not there", "Not needed. Else: python -m hand_recon.prepare mano"
        ),
        Finding("own data", "absent", "16 of 130,240", check + "/own"),
        Finding("whole data", "good", "all there", check),
        Finding("a release", "wrong", "malware", "Remove it, then `make env`."),
    ]
    assert next_command({"": findings[:2]}) == "python -m hand_recon.train"
    assert next_command({"": findings[:3]}) == check + "/own"
    assert next_command({"": findings}) == check
    broken = Finding("torch", "wrong", "not installed", "make env")
    assert next_command({"": [*findings, broken]}) == "make env"


def test_something_broken_makes_the_exit_status(tmp_path: Path) -> None:
    root = write_folder(tmp_path / "own", hands=4).root
    for image in (root / "training" / "rgb").iterdir():
        image.unlink()
    assert not doctor(configuration(tmp_path))


def test_a_release_that_was_malware_is_called_so(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.metadata.version
    monkeypatch.setattr(
        importlib.metadata, "version", lambda name: "2.6.3" if name == "lightning" else real(name)
    )
    (found,) = [one for one in look_at_versions() if one.subject == "lightning"]
    assert found.state == "wrong"
    assert "malware" in found.found


def test_a_full_disk_is_wrong(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hand_recon.inspection.machine.ROOM", 1e18)
    found = look_at_disk("Caches", tmp_path / "not" / "yet")
    assert isinstance(found, Finding)
    assert found.state == "wrong"
    assert "HAND_RECON_CACHE" in found.cure


def write_map(cache: Path, name: str, root: Path, fingerprint: str) -> Path:
    folder = cache / "pictures" / name
    folder.mkdir(parents=True)
    (folder / "crops.npy").write_bytes(b"x" * 1000)
    manifest = {
        "dataset": "d",
        "root": str(root),
        "fingerprint": fingerprint,
        "count": 3,
        "crop": {},
    }
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def test_caches_of_what_changed_or_is_gone_are_found(tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    cache = tmp_path / "cache"
    old = write_map(cache, "old", root, "1")
    write_map(cache, "new", root, "2")
    gone = write_map(cache, "gone", tmp_path / "gone", "3")
    assert [one.folder for one in stale_maps(cache, "d", root, "2")] == [old]
    assert len(crop_maps(cache)) == 3
    found = look_at_caches(cache)
    assert [one.cure for one in found if one.state == "absent"] == [f"rm -r {gone}"]


def test_the_command_leaves_nothing_behind(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "hand_recon.doctor",
        f"folder={tmp_path}",
        f"paths.cache={tmp_path}/c",
    ]
    repository = Path(CONF).parent
    before = sorted(path.name for path in repository.iterdir())
    done = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=True)  # noqa: S603
    assert "Next: python -m hand_recon.train" in done.stdout
    assert sorted(path.name for path in repository.iterdir()) == before
