"""The command `export`: from a file of hands to files of other programs, all or none."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from omegaconf import DictConfig, open_dict

from hand_recon.command_line.configuration_files import CONF
from hand_recon.fitting.hand_records import HandRecords, joined_records
from hand_recon.fitting.hands_file import writing_hands
from hand_recon.formats.by_name import FORMATS
from hand_recon.hand.mano.hand import mano_hand
from hand_recon.hand.model import HandModel
from hand_recon.runs import export_run
from hand_recon.runs.export_run import export, export_hand, format_names
from tests.support.configurations import composed
from tests.support.exported import clip_hands, records_of
from tests.support.mano_file import write_mano_folder
from tests.support.trajectories import still_hand


def asked(*overrides: str) -> DictConfig:
    """`conf/export.yaml` composed."""
    config = composed(*overrides, name="export")
    with open_dict(config):
        del config["hydra"]
    return config


def write_file(path: Path, *parts: HandRecords) -> Path:
    """Write a file of hands."""
    with writing_hands(path) as write:
        write(joined_records(parts))
    return path


def names_below(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def test_several_formats_are_written_at_once(hand: HandModel, tmp_path: Path) -> None:
    source = write_file(tmp_path / "hands.json", *(records_of(one, hand) for one in clip_hands()))
    output = tmp_path / "new" / "files"
    found = export(asked(f"source={source}", "format=[bvh,csv,glb]", f"output={output}"))
    files = {"angles.csv", "clip.glb", "clip_hand_1_left.bvh", "clip_hand_2_right.bvh"}
    assert names_below(output) == files
    assert set(found["files"]) == {str(output / name) for name in files}
    assert found["hands"] == 2


def test_after_a_refusal_nothing_was_written(hand: HandModel, tmp_path: Path) -> None:
    source = write_file(tmp_path / "hands.json", records_of(still_hand(), hand))
    output = tmp_path / "files"
    output.mkdir()
    (output / "clip.glb").write_text("mine")
    with pytest.raises(FileExistsError, match=r"clip\.glb exists and is not overwritten"):
        export(asked(f"source={source}", "format=[csv,glb]", f"output={output}"))
    assert names_below(output) == {"clip.glb"}
    assert (output / "clip.glb").read_text() == "mine"
    with pytest.raises(ValueError, match=r"Unknown format 'fbx'; .*rerun, or onnx for a network"):
        export(asked(f"source={source}", "format=[csv,fbx]", f"output={output}"))
    with pytest.raises(ValueError, match="format=mano needs hands of the hand model mano"):
        export(asked(f"source={source}", "format=[csv,mano]", f"output={output}"))
    assert names_below(output) == {"clip.glb"}
    with pytest.raises(FileNotFoundError, match="No file of hands at"):
        export(asked(f"source={tmp_path / 'none.json'}", f"output={output}"))


def test_a_folder_is_not_left_behind_by_an_error(
    hand: HandModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = write_file(tmp_path / "hands.json", records_of(still_hand(), hand))

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(export_run, "write", interrupted)
    for name, left in (("new", False), ("mine", True)):
        if left:
            (tmp_path / name).mkdir()
        with pytest.raises(KeyboardInterrupt):
            export(asked(f"source={source}", f"output={tmp_path / name}"))
        assert (tmp_path / name).exists() == left


def test_a_file_in_place_of_the_folder_is_refused_with_the_cure(
    hand: HandModel, tmp_path: Path
) -> None:
    source = write_file(tmp_path / "hands.json", records_of(still_hand(), hand))
    for output in (source, source / "new"):
        with pytest.raises(FileExistsError, match=r"cannot be made .* with output="):
            export(asked(f"source={source}", f"output={output}"))


def test_sources_that_hold_no_hands_are_refused_with_what_to_give(
    hand: HandModel, tmp_path: Path
) -> None:
    with pytest.raises(FileNotFoundError, match=r"is a folder.*For the ONNX file of a run"):
        export(asked(f"source={tmp_path}", f"output={tmp_path}"))
    source = write_file(tmp_path / "hands.json", records_of(still_hand(), hand))
    with pytest.raises(FileNotFoundError, match=rf"is a folder.*Give {source}\."):
        export(asked(f"source={tmp_path}", f"output={tmp_path}"))
    with pytest.raises(FileNotFoundError, match=r"packaged lifter.*add format=onnx"):
        export(asked("source=default", f"output={tmp_path}"))


def test_hands_of_mano_need_mano(tmp_path: Path) -> None:
    folder = write_mano_folder(tmp_path / "mano")
    records = records_of(still_hand(), mano_hand(folder))
    source = write_file(tmp_path / "hands.json", records)
    words = f"source={source}", f"output={tmp_path / 'files'}", "format=[mano,glb]"
    with pytest.raises(ValueError, match=r"hands of the hand model mano.*Add hand=mano"):
        export(asked(*words))
    export(asked(*words, "hand=mano", f"hand.path={folder}"))
    assert names_below(tmp_path / "files") == {"clip.glb", "clip_hand_1_right.mano.npz"}
    other = write_file(tmp_path / "open.json", replace(records, hand_models=("open",)))
    with pytest.raises(ValueError, match="Give the model of these hands, hand=open"):
        export(asked(f"source={other}", "hand=mano", f"hand.path={folder}"))


def test_fingertips_are_the_meshs_own(hand: HandModel) -> None:
    model = export_hand(asked("source=a"))
    assert (model.name, model.landmark_set) == ("open", "knuckle")


@pytest.mark.parametrize(
    ("given", "names"),
    [("glb", ["glb"]), ("glb, bvh,glb", ["glb", "bvh"]), (["csv", "bvh"], ["csv", "bvh"])],
)
def test_names_are_given_in_a_text_or_a_list(given: str | list[str], names: list[str]) -> None:
    assert format_names(given) == names


def test_no_name_is_refused() -> None:
    with pytest.raises(ValueError, match="No format was given; expected one or more of glb, bvh"):
        format_names(" ,")


def test_the_configuration_names_every_format() -> None:
    text = (Path(CONF) / "export.yaml").read_text()
    # Networks, after the semicolon, are no hands.
    comment = text.split("commas between them:")[1].split(";")[0]
    assert {word.strip("# \n") for word in comment.split(",")} == set(FORMATS)


def test_the_json_of_a_hand_without_a_clip_is_a_still(hand: HandModel, tmp_path: Path) -> None:
    records = records_of(still_hand(), hand, image="a/b.jpg", of_clip=False)
    source = write_file(tmp_path / "hands.json", records)
    (file,) = export(asked(f"source={source}", "format=openxr", f"output={tmp_path / 'out'}"))[
        "files"
    ]
    assert Path(file).name == "a-b.openxr.json"
    (entry,) = json.loads(Path(file).read_text())["hands"]
    assert [one["time"] for one in entry["frames"]] == [0.0]
