import json
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig
from torch import Tensor

from hand_recon.__main__ import main
from hand_recon.command_line.configuration_files import CONF
from hand_recon.data.freihand.datamodule import FreiHandDataModule
from hand_recon.data.images import read_image
from hand_recon.hand.open_hand import open_hand
from hand_recon.inspection.contact_sheet import contact_sheet
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.rehearsal.freihand import FreiHandFolder, write_freihand_layout
from hand_recon.runs import preparation as prepare
from hand_recon.runs.building import build_data
from hand_recon.schema import HandBatch
from tests.support.detector_models import made_up_models, zipped
from tests.support.freihand_folder import edit_json
from tests.support.mano_file import write_mano_pickle


@pytest.fixture(scope="module")
def freihand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("data") / "FreiHAND_pub_v2"
    write_freihand_layout(root, FreiHandFolder(unique=10, evaluation=3, with_vertices=False))
    return root


def configuration(root: Path, folder: Path, *overrides: str) -> DictConfig:
    with initialize_config_dir(CONF, version_base="1.3"):
        return compose(
            "prepare",
            ["data=freihand", f"data.root={root}", "crop_size=64", f"paths.cache={folder / 'cache'}",
             f"paths.run={folder / 'run'}", *overrides],
        )  # fmt: skip


def test_check_draws_a_page_and_writes_the_numbers(freihand: Path, tmp_path: Path) -> None:
    report = prepare.check(configuration(freihand, tmp_path, "check.samples=4", "check.numbers=20"))
    assert report.troubles == ()
    page = read_image(tmp_path / "run" / "samples.png")
    assert page is not None
    # Something was drawn in every finger's colour.
    assert (np.abs(page.astype(int) - (205, 50, 160)).sum(axis=-1) < 10).sum() > 20
    written = json.loads((tmp_path / "run" / "labels.json").read_text())
    assert written["numbers"]["samples"] == 20


def test_check_refuses_a_wrong_order_with_the_diagnosis(tmp_path: Path) -> None:
    root = tmp_path / "own"
    write_freihand_layout(root, FreiHandFolder(unique=10, evaluation=0, with_vertices=False))
    # Fingers written from tip to base, as RHD has them.
    order = [0, *(4 * finger + 4 - part for finger in range(5) for part in range(4))]

    def reorder(array: np.ndarray) -> None:
        array[:] = array[:, order]

    edit_json(root / "training_xyz.json", reorder)
    (root / "training_scale.json").unlink()
    with pytest.raises(ValueError, match=r"(?s)not ready to be trained on.*order of 'rhd'"):
        prepare.check(configuration(root, tmp_path))
    # What was found can be looked at all the same.
    assert (tmp_path / "run" / "samples.png").is_file()


def test_cache_decodes_every_split_once_and_names_what_is_stale(
    freihand: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = prepare.cache(configuration(freihand, tmp_path))
    assert first["samples"] == {"train": 36, "val": 1, "test": 3}
    assert len(first["maps"]) == 2
    assert first["stale"] == {}
    again = prepare.cache(configuration(freihand, tmp_path))
    assert again["maps"] == first["maps"]
    for label in (freihand / "training_xyz.json",):
        edit_json(label, lambda array: np.add(array, [0, 0, 1e-4], out=array))
    changed = prepare.cache(configuration(freihand, tmp_path))
    assert set(changed["stale"]) < set(first["maps"])
    assert len(changed["stale"]) == 1
    assert "nothing reads them" in caplog.text


def test_mano_is_converted_into_the_folder_that_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_mano_pickle(tmp_path / "MANO_RIGHT.pkl")
    main(["prepare", "mano", str(tmp_path / "MANO_RIGHT.pkl"), f"folder={tmp_path / 'mano'}"])
    written = tmp_path / "mano" / "MANO_RIGHT.safetensors"
    assert written.is_file()
    assert f"Ready: {written}" in capsys.readouterr().out


def test_mano_without_a_source_says_how_it_is_used() -> None:
    with pytest.raises(SystemExit, match=r"No MANO download was given: .*prepare mano"):
        main(["prepare", "mano"])


def test_mano_takes_one_source(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["prepare", "mano", "a.pkl", "b.pkl"])
    assert refused.value.code == 2
    assert "Unexpected word 'b.pkl'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "No file"),
        (b"\x80\x02cos\nsystem\nU\x02ls\x85R.", "os"),
        (b"PK\x03\x04 cut off", ""),
    ],
)
def test_mano_is_refused_with_the_message_alone(
    tmp_path: Path, content: bytes | None, message: str
) -> None:
    source = tmp_path / "MANO_RIGHT.pkl"
    if content is not None:
        source.write_bytes(content)
    # Python prints a text that a program ends with, without a traceback, and exits with status 1.
    with pytest.raises(SystemExit, match=rf"{source}") as stopped:
        main(["prepare", "mano", str(source), f"folder={tmp_path / 'm'}"])
    assert isinstance(stopped.value.code, str)
    assert message in stopped.value.code
    assert not (tmp_path / "m").exists()


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    """Made-up models of the detector, and a cache folder of the test's own."""
    monkeypatch.setenv("HAND_RECON_CACHE", str(tmp_path / "cache"))
    return made_up_models(monkeypatch)


def test_detector_is_taken_from_the_file_that_is_named(
    models: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bundle = tmp_path / "a bundle, named (oddly).task"
    bundle.write_bytes(zipped(models))
    main(["prepare", "detector", str(bundle)])
    folder = tmp_path / "cache" / "detector"
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == models
    printed = capsys.readouterr().out
    assert all(f"Ready: {folder / name}" in printed for name in models)
    # Nothing is fetched where everything is there.
    main(["prepare", "detector"])
    assert f"Both models are in {folder} already." in capsys.readouterr().out
    # It is no run: no folder of results is left.
    assert sorted(path.name for path in tmp_path.iterdir()) == [bundle.name, "cache"]


def test_detector_takes_several_files_and_another_folder(
    models: dict[str, bytes], tmp_path: Path
) -> None:
    for name, content in models.items():
        (tmp_path / name).write_bytes(content)
    files = ",".join(f"'{tmp_path / name}'" for name in models)
    main(["prepare", "task=detector", f"source=[{files}]", f"folder={tmp_path / 'mine'}"])
    assert sorted(path.name for path in (tmp_path / "mine").iterdir()) == sorted(models)


@pytest.mark.usefixtures("models")
def test_detector_is_refused_with_the_message_alone(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"No file .*none.task. Name MediaPipe's") as stopped:
        main(["prepare", "detector", str(tmp_path / "none.task")])
    assert isinstance(stopped.value.code, str)
    (tmp_path / "other.zip").write_bytes(zipped({"a": b"b"}))
    with pytest.raises(SystemExit, match="none of the models is in it"):
        main(["prepare", "detector", str(tmp_path / "other.zip")])
    assert not (tmp_path / "cache").exists()


def synthetic(folder: Path) -> DictConfig:
    with initialize_config_dir(CONF, version_base="1.3"):
        return compose(
            "prepare",
            ["data=synthetic", "synthetic.train=8", "crop_size=64", f"paths.cache={folder / 'cache'}",
             f"paths.run={folder / 'run'}", "check.samples=2"],
        )  # fmt: skip


def test_check_shows_training_surfaces_and_compares_poses_with_joint_ranges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[HandBatch] = []

    def recorded(batch: HandBatch, faces: Tensor) -> np.ndarray:
        shown.append(batch)
        return contact_sheet(batch, faces)

    monkeypatch.setattr(prepare, "contact_sheet", recorded)
    config = synthetic(tmp_path)
    numbers = prepare.check(config).numbers
    assert shown[0].vertices is not None
    assert shown[0].vertices.isfinite().all()
    parameters = build_data(config).train_parameters()
    assert parameters is not None
    ranges = load_ranges("literature", open_hand().rest_angles)
    low, high = ranges.lower.double().numpy(), ranges.upper.double().numpy()
    largest = np.degrees([
        max(0.0, (angles - high).max(), (low - angles).max())
        for angles in parameters.joint_angles.double().numpy()
    ])  # fmt: skip
    assert numbers["poses"] == len(largest) == 8
    assert numbers["largest_violation_degrees_mean"] == pytest.approx(largest.mean(), abs=1e-4)
    assert numbers["beyond_ranges_percent"] == pytest.approx(100 * (largest > 22.5).mean())
    assert json.loads((tmp_path / "run" / "labels.json").read_text())["numbers"] == numbers


def test_check_goes_on_where_poses_cannot_be_had(
    freihand: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def no_mano(data: FreiHandDataModule, limit: int) -> None:
        raise FileNotFoundError("No MANO_RIGHT.safetensors.")

    monkeypatch.setattr(FreiHandDataModule, "train_parameters", no_mano)
    report = prepare.check(configuration(freihand, tmp_path))
    assert report.troubles == ()
    assert not any("beyond" in name for name in report.numbers)
    assert "were not compared with joint ranges: No MANO_RIGHT.safetensors." in caplog.text


def test_a_task_is_needed_and_must_be_known(tmp_path: Path) -> None:
    config = configuration(tmp_path, tmp_path)
    with pytest.raises(
        ValueError, match="No task was given: type hand-recon prepare with mano, detector, cache"
    ):
        prepare.prepare(config)
    with pytest.raises(ValueError, match="prepare cache takes no file, found 'mine'"):
        prepare.prepare(configuration(tmp_path, tmp_path, "task=cache", "source=mine"))
    config.task = "meals"
    with pytest.raises(ValueError, match="Unknown task 'meals'"):
        prepare.prepare(config)


def test_a_task_gets_the_configuration(freihand: Path, tmp_path: Path) -> None:
    config = configuration(freihand, tmp_path, "task=cache", "splits=[test]")
    assert prepare.prepare(config)["samples"] == {"test": 3}
