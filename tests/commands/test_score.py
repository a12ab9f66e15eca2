"""Files of predictions from the command line to the JSON of their scores."""

import json
import logging
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import DictConfig, open_dict

from hand_recon.evaluation.scores import HandPoints
from hand_recon.hand.model import HandModel
from hand_recon.protocols.benchmarks import PROTOCOLS
from hand_recon.protocols.scoring import submit
from hand_recon.protocols.submission import write_submission
from hand_recon.runs.evaluation_run import evaluate
from hand_recon.runs.scoring_run import score
from tests.support.configurations import composed
from tests.support.golden import SCORES, golden_hands
from tests.support.predicted_hands import noisy, true_hands, write_ground_truth


def settings(folder: Path, *overrides: str) -> DictConfig:
    config = composed(*overrides, name="score")
    with open_dict(config):
        config.paths = {"cache": str(folder), "output": str(folder), "run": str(folder / "run")}
    return config


def files(
    tmp_path: Path, name: str, ground_truth: HandPoints, prediction: HandPoints
) -> tuple[str, ...]:
    protocol = PROTOCOLS[name]
    if name == "dexycb":
        # In metres, as FreiHAND's: DexYCB publishes no file of its ground truth.
        write_ground_truth(tmp_path / "truth", ground_truth, PROTOCOLS["freihand"])
    else:
        write_ground_truth(tmp_path / "truth", ground_truth, protocol)
    path = write_submission(protocol, prediction, tmp_path)[0]
    return f"predictions={path}", f"protocol={name}", f"ground_truth={tmp_path / 'truth'}"


def test_the_golden_predictions_have_the_official_scores(tmp_path: Path) -> None:
    """Not rounded as a submission is: the arrays' own digits, mistaken by nobody."""
    ground_truth, prediction = golden_hands("noise")
    write_ground_truth(tmp_path / "truth", ground_truth, PROTOCOLS["freihand"])
    assert prediction.vertices is not None
    lists = [prediction.landmarks.tolist(), prediction.vertices.tolist()]
    (tmp_path / "pred.json").write_text(json.dumps(lists))
    output = tmp_path / "scores.json"
    found = score(
        settings(
            tmp_path, f"predictions={tmp_path / 'pred.json'}", "protocol=freihand",
            f"ground_truth={tmp_path / 'truth'}", f"output={output}", "threads=1",
        )
    )  # fmt: skip
    written = json.loads(output.read_text())
    assert written == json.loads(json.dumps(found))
    assert written == json.loads((tmp_path / "run" / "scores.json").read_text())
    official = SCORES["noise"]["freihand"]
    assert {key: round(written[key], 6) for key in official} == official
    assert written.keys() - official.keys() == {"frames", "remarks", "lint"}
    assert written["frames"] == len(ground_truth)


@pytest.mark.parametrize("name", ["freihand", "ho3d_v3", "dexycb"])
def test_a_submission_is_scored_in_its_own_form(
    name: str, hand: HandModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ground_truth = true_hands(hand, 8)
    prediction = noisy(ground_truth, 0.005)
    found = score(settings(tmp_path, *files(tmp_path, name, ground_truth, prediction), "threads=1"))
    for key, value in PROTOCOLS[name].scores(ground_truth, prediction).items():
        assert found[key] == pytest.approx(value, rel=0.02)
    assert found["lint"] == []
    printed = capsys.readouterr().out
    assert "E_J: " in printed
    assert "No mistake found" in printed
    assert ("xyz_mean3d: " in printed) == (name != "dexycb")


def test_a_mistake_is_printed_and_written(
    hand: HandModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ground_truth = true_hands(hand, 8)
    wrong = HandPoints(ground_truth.landmarks * torch.tensor([1.0, -1.0, -1.0]))
    found = score(
        settings(tmp_path, *files(tmp_path, "freihand", ground_truth, wrong), "threads=1")
    )
    assert [finding["kind"] for finding in found["lint"]] == ["axes"]
    printed = capsys.readouterr().out
    assert "Mistake (certain): Your hands look to be in OpenGL's axes" in printed
    assert "landmarks alone are scored, and the surface's scores are -1" in printed
    assert found["mesh_mean3d"] == -1


def test_a_mirrored_hand_shows_its_proper_error(
    hand: HandModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ground_truth = true_hands(hand, 8)
    wrong = HandPoints(ground_truth.landmarks * torch.tensor([-1.0, 1.0, 1.0]))
    score(settings(tmp_path, *files(tmp_path, "freihand", ground_truth, wrong), "threads=1"))
    assert "E_J_proper: " in capsys.readouterr().out


def test_an_output_is_not_overwritten(hand: HandModel, tmp_path: Path) -> None:
    ground_truth = true_hands(hand, 3)
    output = tmp_path / "mine.json"
    output.write_text("mine")
    with pytest.raises(FileExistsError, match=r"mine.json exists"):
        score(
            settings(
                tmp_path,
                *files(tmp_path, "freihand", ground_truth, ground_truth),
                f"output={output}",
            )
        )
    assert output.read_text() == "mine"


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ([], r"No predictions were given"),
        (["predictions=a"], r"need protocol=<name> and ground_truth"),
        (["predictions=a", "protocol=ho3d", "ground_truth=b"], r"known are freihand, ho3d_v2"),
    ],
)
def test_what_is_missing_is_said(overrides: list[str], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        score(settings(tmp_path, *overrides))


def test_evaluate_without_a_checkpoint_names_both_commands() -> None:
    with pytest.raises(ValueError, match=r"No checkpoint was given.*hand-recon score"):
        evaluate(composed(name="evaluate"))


def test_a_test_set_is_submitted(
    hand: HandModel, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    ground_truth = true_hands(hand, 3)
    with caplog.at_level(logging.INFO):
        paths = submit(
            "ho3d_v3", ground_truth.landmarks, ground_truth.vertices, tmp_path / "submission"
        )
    assert [path.name for path in paths] == ["pred.json", "pred.zip"]
    assert "pred.zip" in caplog.text


@pytest.mark.slow
def test_the_command_line_leaves_one_folder(hand: HandModel, tmp_path: Path) -> None:
    ground_truth = true_hands(hand, 3)
    arguments = files(tmp_path / "files", "freihand", ground_truth, ground_truth)
    command = [sys.executable, "-m", "hand_recon.score", *arguments, "threads=1"]
    done = subprocess.run(command, check=True, cwd=tmp_path, capture_output=True, text=True)  # noqa: S603
    assert "xyz_al_mean3d: 0.00" in done.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["files", "outputs"]
    scores: list[Any] = list(tmp_path.glob("outputs/score/*/scores.json"))
    assert len(scores) == 1
