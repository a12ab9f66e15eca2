"""`same_person`: the hands of a file, of photographs and of arrays are fitted with one shape."""

import itertools
import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from omegaconf import DictConfig, open_dict

import hand_recon
from hand_recon.camera import project
from hand_recon.fitting import in_parts
from hand_recon.hand.model import HandModel
from hand_recon.runs import fit_run, predict_run
from hand_recon.runs.fit_run import fit
from hand_recon.runs.predict_run import predict
from tests.support import photo_folder
from tests.support.configurations import composed
from tests.support.mano_file import write_mano_folder
from tests.support.photo_folder import CAMERA
from tests.support.views import known_hands, views

COUNT = 5
WORDS = ("lifter=none", "descent.starts=2", "results.meshes=0", "results.pictures=0")


def asked(output: Path, *overrides: str) -> DictConfig:
    """`conf/fit.yaml` composed for a folder of ours."""
    config = composed("threads=1", *overrides, f"output={output}", name="fit")
    with open_dict(config):
        del config["hydra"]
    return config


def pixels(hand: HandModel, count: int = COUNT) -> torch.Tensor:
    """Landmarks before `CAMERA`; every other hand is a left one."""
    one_shape = torch.linspace(-1.5, 1.5, 10).expand(count, 10)
    batch = views(hand, replace(known_hands(hand, count), shape=one_shape))
    assert batch.landmarks_3d is not None
    found = project(batch.landmarks_3d, torch.tensor(CAMERA).expand(count, 3, 3))
    found[1::2, :, 0] = 2 * CAMERA[0][2] - found[1::2, :, 0]
    return found


@pytest.fixture
def landmarks(hand: HandModel, tmp_path: Path) -> Path:
    """Hands with σ of a pixel, and one that has too few landmarks."""
    entries: list[dict[str, Any]] = [
        {"side": "left" if number % 2 else "right", "landmarks": points, "sigma": [1.0] * 21}
        for number, points in enumerate(pixels(hand).tolist())
    ]
    entries[2]["landmarks"][3:] = [None] * 18
    path = tmp_path / "hands.json"
    path.write_text(json.dumps(entries))
    (tmp_path / "K.json").write_text(json.dumps(CAMERA))
    return path


def shapes(folder: Path) -> list[Any]:
    entries = json.loads((folder / "hands.json").read_text())
    return [entry["shape"] for entry in entries if entry["shape"] is not None]


def test_all_hands_of_a_file_have_one_shape(landmarks: Path, tmp_path: Path) -> None:
    words = (f"landmarks={landmarks}", f"intrinsics={tmp_path / 'K.json'}", *WORDS)
    summary = fit(asked(tmp_path / "person", *words, "same_person=true"))
    fit(asked(tmp_path / "any", *words))
    assert (summary["hands"], summary["fitted"]) == (COUNT, COUNT - 1)
    person, others = shapes(tmp_path / "person"), shapes(tmp_path / "any")
    assert len(person) == COUNT - 1
    assert all(shape == person[0] for shape in person)
    assert any(shape != others[0] for shape in others)
    # The landmarks are met as well as before: the shape is one that the hands could have.
    entries = [
        json.loads((tmp_path / name / "hands.json").read_text()) for name in ("person", "any")
    ]
    residuals = [np.mean([entry["residual"] or 0 for entry in hands]) for hands in entries]
    assert residuals[0] < residuals[1] + 2.0


@pytest.mark.slow
def test_parts_of_a_file_and_an_interruption_do_not_change_the_shape(
    landmarks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (f"landmarks={landmarks}", *WORDS, "same_person=true")
    fit(asked(tmp_path / "whole", *words))
    real, stops = in_parts.fit_in_parts, itertools.count()

    def one_by_one(hands: Any, fitter: Any, **options: Any) -> Any:  # noqa: ANN401
        interrupted = next(stops) == 0
        for number, part in enumerate(real(hands, fitter, size=1, **options)):
            if interrupted and number == 2:
                raise KeyboardInterrupt
            yield part

    monkeypatch.setattr(fit_run, "fit_in_parts", one_by_one)
    with pytest.raises(KeyboardInterrupt):
        fit(asked(tmp_path / "out", *words))
    fit(asked(tmp_path / "out", *words))
    assert shapes(tmp_path / "out") == shapes(tmp_path / "whole")


def test_one_hand_alone_is_fitted_as_without(hand: HandModel) -> None:
    one = pixels(hand, 1)[0].numpy()
    fits = [
        hand_recon.fit_landmarks(one, intrinsics=CAMERA, overrides=[*WORDS[:2], *more])
        for more in ([], ["same_person=true"])
    ]
    np.testing.assert_array_equal(fits[0].landmarks_3d, fits[1].landmarks_3d)


def test_arrays_have_one_shape_that_both_sides_share(hand: HandModel) -> None:
    sides = ["left" if number % 2 else "right" for number in range(COUNT)]
    found = hand_recon.fit_landmarks(
        pixels(hand).numpy(),
        side=sides,
        intrinsics=CAMERA,
        overrides=[*WORDS[:2], "same_person=true"],
    )
    shape = torch.cat([part.prediction.parameters.shape for part in found.parts])
    assert (shape == shape[0]).all()
    assert found.sides == tuple(sides)


def test_hands_of_all_photographs_have_one_shape(hand: HandModel, tmp_path: Path) -> None:
    folder = photo_folder.photo_folder(hand, tmp_path)
    with pytest.raises(ValueError, match="1 of 4 images could not be processed"):
        predict(photo_folder.asked(folder, "same_person=true", "results.overlays=false"))
    person = shapes(folder / "out")
    assert len(person) == 3
    assert all(shape == person[0] for shape in person)


def test_photographs_of_an_interrupted_command_keep_the_shape_of_all(
    hand: HandModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = photo_folder.photo_folder(hand, tmp_path)
    words = ("same_person=true", "results.overlays=false")
    monkeypatch.setattr(predict_run, "PHOTOS_AT_ONCE", 1)
    real, stops = in_parts.fit_part, itertools.count()

    def interrupted(*given: Any) -> Any:  # noqa: ANN401
        if next(stops) == 1:
            raise KeyboardInterrupt
        return real(*given)

    monkeypatch.setattr(predict_run, "fit_part", interrupted)
    with pytest.raises(KeyboardInterrupt):
        predict(photo_folder.asked(folder, *words))
    with pytest.raises(ValueError, match="1 of 4 images could not be processed"):
        predict(photo_folder.asked(folder, *words))
    person = shapes(folder / "out")
    assert len(person) == 3
    assert all(shape == person[0] for shape in person)


def test_the_hands_of_a_dataset_are_not_one_persons(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"same_person=true with data=.*several people"):
        fit(asked(tmp_path / "out", "data=views", "same_person=true"))
    assert not (tmp_path / "out" / "config.yaml").exists()


def notes(caplog: pytest.LogCaptureFixture) -> list[str]:
    """Messages on the lifter's hand and on the solver."""
    places = ("hand_recon.runs.lifters", "hand_recon.fitting.descent")
    return [record.getMessage() for record in caplog.records if record.name in places]


def test_the_lifters_own_hand_with_one_shape_is_not_taken_for_another_one(
    hand: HandModel, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = photo_folder.photo_folder(hand, tmp_path)
    words = ("lifter=default", "same_person=true")
    with caplog.at_level(logging.INFO):
        hand_recon.fit_landmarks(pixels(hand).numpy(), intrinsics=CAMERA, overrides=words)
        with pytest.raises(ValueError, match="could not be processed"):
            predict(photo_folder.asked(folder, *words, "results.overlays=false"))
    assert "share a shape" in caplog.text
    assert not notes(caplog)


@pytest.mark.parametrize("command", ["fit", "predict"])
def test_notes_on_another_hand_come_once(
    hand: HandModel, tmp_path: Path, caplog: pytest.LogCaptureFixture, command: str
) -> None:
    """A hand in MANO's layout is not the lifter's, and is fitted by Adam."""
    folder = photo_folder.photo_folder(hand, tmp_path)
    mano = write_mano_folder(tmp_path / "mano")
    words = (
        "hand=mano",
        f"hand.path='{mano}'",
        "lifter=default",
        "same_person=true",
    )
    with caplog.at_level(logging.INFO):
        if command == "fit":
            hand_recon.fit_landmarks(
                pixels(hand).numpy(), intrinsics=CAMERA, overrides=[*words, *photo_folder.QUICK]
            )
        else:
            with pytest.raises(ValueError, match="could not be processed"):
                predict(photo_folder.asked(folder, *words, "results.overlays=false"))
    assert "share a shape" in caplog.text
    solver, lifter = notes(caplog)
    assert "The lifter was made for the hand open" in lifter
    assert "fit of the hand mano, its shape does not" in lifter
    assert solver.startswith("Fitting by Adam, which is slower")
    assert "of the hand 'mano'." in solver
