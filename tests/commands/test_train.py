"""The main job from end to end, small: fit, test, draw, evaluate again, resume, refuse."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from hand_recon.data.augment import to_float
from hand_recon.rehearsal.freihand import FreiHandFolder, write_freihand_layout
from hand_recon.runs.building import build_data
from hand_recon.runs.checkpoints import load_trained
from hand_recon.runs.evaluation_run import evaluate
from hand_recon.runs.training_run import train
from hand_recon.training.module import reference_residual
from hand_recon.uncertainty.sigma_factor import sigma_factor
from tests.support.configurations import settings
from tests.support.small_runs import LIGHTNING_WARNINGS, SMALL

pytestmark = LIGHTNING_WARNINGS


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def run(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    folder = tmp_path_factory.mktemp("run")
    return folder, train(settings(cache, folder, *SMALL))


def test_a_run_leaves_what_the_readme_promises(run: tuple[Path, dict[str, object]]) -> None:
    folder, metrics = run
    written = json.loads((folder / "metrics.json").read_text())
    assert written["test"] == metrics["test"]
    assert {"E_J", "E_V", "E_RV", "MPJPE", "AUC_J", "AUC_V", "F@5", "F@15"} <= set(written["test"])
    assert {"E_J", "E_V"} <= set(written["mean_pose"])
    for name in ("report.html", "curves.png", "config.yaml", "checkpoints/best.ckpt",
                 "checkpoints/last.ckpt", "csv/metrics.csv"):  # fmt: skip
        assert (folder / name).stat().st_size > 0, name
    assert len(list((folder / "overlays").glob("*.png"))) == 3
    assert list((folder / "tensorboard").glob("events*"))


def test_the_checkpoint_has_the_factor_of_sigma_of_its_own_validation_hands(
    run: tuple[Path, dict[str, object]], cache: Path
) -> None:
    folder, _ = run
    trained = load_trained(folder)
    data = build_data(settings(cache, folder, *SMALL))
    data.setup("validate")
    residuals, sigmas = [], []
    for loaded in data.val_dataloader():
        batch = to_float(loaded)
        with torch.no_grad():
            found = trained.module(batch)
        residuals.append(reference_residual(batch, found)[batch.labelled].flatten())
        sigmas.append(found.log_sigma.exp()[batch.labelled].flatten())
    expected = sigma_factor(torch.cat(residuals).double(), torch.cat(sigmas).double())
    assert trained.sigma_factor == pytest.approx(expected, rel=1e-3)
    assert expected != pytest.approx(1.0, rel=0.01)


def test_evaluation_gives_the_numbers_of_the_training_run(
    run: tuple[Path, dict[str, object]], cache: Path, tmp_path: Path
) -> None:
    folder, metrics = run
    again = evaluate(settings(cache, tmp_path, f"ckpt={folder}", "threads=1", name="evaluate"))
    assert again["test"] == pytest.approx(metrics["test"], rel=1e-6)
    assert again["mean_pose"] == pytest.approx(metrics["mean_pose"], rel=1e-6)


@pytest.mark.slow
def test_a_run_that_is_continued_ends_like_one_that_was_not(cache: Path, tmp_path: Path) -> None:
    """One epoch, then a second: the losses of the second are those of the run of two epochs."""
    first, second = tmp_path / "first", tmp_path / "second"
    # A constant rate and a switch after an epoch: shares of one epoch and of two are different schedules.
    constant = [
        *SMALL, "optimizer.schedule=null", "data_term=mse_then_nll", "data_term.unit=epoch",
        "data_term.switch_at=1",
    ]  # fmt: skip
    whole = train(settings(cache, tmp_path / "whole", *constant))
    train(settings(cache, first, *constant, "trainer.max_epochs=1"))
    continued = train(settings(cache, second, *constant, f"resume={first}"))
    assert continued["test"] == pytest.approx(whole["test"], rel=1e-4)


def test_a_run_with_nothing_left_to_do_keeps_the_best_that_it_had(
    run: tuple[Path, dict[str, object]], cache: Path, tmp_path: Path
) -> None:
    folder, metrics = run
    again = train(settings(cache, tmp_path / "again", *SMALL, f"resume={folder}"))
    assert again["test"] == pytest.approx(metrics["test"], rel=1e-6)
    assert (tmp_path / "again" / "checkpoints" / "best.ckpt").is_file()
    assert (folder / "checkpoints" / "best.ckpt").is_file()


def test_a_worse_continuation_does_not_replace_the_best(
    run: tuple[Path, dict[str, object]], cache: Path, tmp_path: Path
) -> None:
    """With a rate that ruins the network, whatever follows is worse than what was there."""
    folder, metrics = run
    last = folder / "checkpoints" / "last.ckpt"
    checkpoint = torch.load(last, weights_only=True)
    for name, state in checkpoint["callbacks"].items():
        if name.startswith("ModelCheckpoint"):
            state["best_model_score"] = torch.tensor(0.0)
    old = tmp_path / "old" / "checkpoints"
    old.mkdir(parents=True)
    torch.save(checkpoint, old / "last.ckpt")
    shutil.copy2(folder / "checkpoints" / "best.ckpt", old / "best.ckpt")
    more = [*(text for text in SMALL if "epochs" not in text), "trainer.max_epochs=3"]
    continued = train(settings(cache, tmp_path / "new", *more, f"resume={tmp_path / 'old'}"))
    assert continued["test"] == pytest.approx(metrics["test"], rel=1e-6)


def test_a_run_is_not_continued_with_other_settings(
    run: tuple[Path, dict[str, object]], cache: Path, tmp_path: Path
) -> None:
    folder, _ = run
    with pytest.raises(
        ValueError, match=r"other settings: .*prior\.range_of_motion\.weight was 20000.0, is absent"
    ):
        train(settings(cache, tmp_path, *SMALL, "prior=none", f"resume={folder}"))


@pytest.mark.slow
def test_a_freihand_folder_trains_and_is_evaluated(
    run: tuple[Path, dict[str, object]], cache: Path, tmp_path: Path
) -> None:
    root = tmp_path / "FreiHAND"
    write_freihand_layout(root, FreiHandFolder(unique=12, evaluation=8))
    small = [text for text in SMALL if not text.startswith(("data.", "crop", "synthetic"))]
    data = ["data=freihand", f"data.root={root}", "data.batch_size=16", "data.reading.workers=1"]
    metrics = train(settings(cache, tmp_path / "run", *small, *data, "trainer.max_epochs=1"))
    assert {"E_J", "E_V", "E_2D"} <= set(metrics["test"])
    folder, _ = run
    other = evaluate(
        settings(cache, tmp_path / "other", f"ckpt={folder}", *data, "threads=1", name="evaluate")
    )
    assert other["landmarks"] == "mano"
    assert {"E_J", "E_V", "E_2D"} <= set(other["test"])


def sweep(output: Path, cache: Path, *more: str) -> dict[str, object]:
    """Two rows as one multirun; the test scores of each run's folder."""
    small = [text for text in SMALL if "epochs" not in text]
    command = [
        sys.executable, "-m", "hand_recon.train", "-m", "experiment=ablation_row1,ablation_row2",
        *small, "trainer.max_epochs=1", f"paths.output={output}", f"paths.cache={cache}", *more,
    ]  # fmt: skip
    subprocess.run(command, check=True, cwd=output)  # noqa: S603  # our own program
    assert len(list(output.glob("sweeps/*/*/report.html"))) == 2
    found = sorted(output.glob("sweeps/*/*/metrics.json"))
    return {path.parent.name: json.loads(path.read_text())["test"] for path in found}


def test_runs_side_by_side_have_folders_named_by_their_overrides(
    tmp_path: Path, cache: Path
) -> None:
    first, second = sweep(tmp_path, cache, "hydra.launcher.n_jobs=2")
    assert first.startswith("0_experiment-ablation_row1")
    assert second.startswith("1_experiment-ablation_row2")


@pytest.mark.slow
def test_runs_side_by_side_end_where_runs_in_turn_do(tmp_path: Path, cache: Path) -> None:
    for name in ("turn", "side"):
        (tmp_path / name).mkdir()
    in_turn = sweep(tmp_path / "turn", cache)
    # Runs have processes of their own: that render, for the cache is new, and that load.
    processes = ("data.render_workers=2", "workers=1", "hydra.launcher.n_jobs=2")
    assert sweep(tmp_path / "side", tmp_path / "fresh", *processes) == in_turn
