"""Runs become the paper's table: means, deviations, changes and intervals that can be counted by hand."""

import csv
import os
from pathlib import Path
from typing import Any

import pytest
from omegaconf import OmegaConf

from hand_recon.runs.tables_run import report
from hand_recon.tables.paper import KNOWLEDGE, TABLE_1, PaperRow, knowledge_of
from hand_recon.tables.runs import flattened
from tests.support.configurations import composed
from tests.support.runs_on_disk import report_config, write_run

KNOWN = {
    1: (0.0, False, 0.0, "SquaredError"),
    2: (20_000.0, False, 0.0, "SquaredError"),
    3: (20_000.0, True, 0.0, "SquaredError"),
    4: (20_000.0, True, 20_000.0, "SquaredError"),
    5: (20_000.0, True, 20_000.0, "NegativeLogLikelihood"),
}
"""λ₁, functional anatomy, λ₂ and data term of each row."""

RULES = {"_target_": "hand_recon.knowledge.functional_anatomy.FunctionalAnatomy"}


def settings(row: int, seed: int, **changes: object) -> dict[str, Any]:
    """Settings of a run of a row, as many as matter here."""
    ranges, anatomy, physics, term = KNOWN[row]
    config = {
        "name": f"ablation_row{row}",
        "seed": seed,
        "crop_size": 64,
        "data": {"level": "easy", "train_size": 12000, "seed": seed, "cache_dir": f"/a/{seed}"},
        "model": {"encoder": {"backbone": "resnet18"}},
        "trainer": {"max_epochs": 10, "default_root_dir": f"/runs/{row}_{seed}"},
        "prior": {
            "range_of_motion": {"weight": ranges, "anatomy": RULES if anatomy else None},
            "non_penetration": {"weight": physics},
        },
        "data_term": {"_target_": f"hand_recon.uncertainty.{term}"},
    }  # fmt: skip
    for name, value in changes.items():
        OmegaConf.update(node := OmegaConf.create(config), name, value, force_add=True)
        config = OmegaConf.to_container(node)  # type: ignore[assignment]
    return config


def lines_of(output: Path) -> dict[str, dict[str, str]]:
    """The CSV by its rows' labels, of the last study that has the row."""
    with (output / "table1.csv").open(newline="") as stream:
        return {line["row"]: line for line in csv.DictReader(stream)}


def number(text: str) -> float | None:
    return float(text) if text else None


@pytest.fixture
def sweep(tmp_path: Path) -> Path:
    """Rows 1 and 2 with three seeds, row 4 with one; the errors of each hand are known for rows 1 and 2."""
    folder = tmp_path / "sweeps" / "2026-01-02_03-04-05"
    for seed, (first, second) in enumerate([(20.0, 10.0), (22.0, 11.0), (24.0, 12.0)]):
        write_run(
            folder / f"{seed}_row1", settings(1, seed), {"E_J": first, "PR": 40.0},
            [first - 3, first - 1, first + 1, first + 3],
        )  # fmt: skip
        write_run(
            folder / f"{seed}_row2", settings(2, seed), {"E_J": second, "PR": 10.0},
            [second - 3, second - 1, second + 1, second + 3],
        )  # fmt: skip
    write_run(folder / "0_row4", settings(4, 0), {"E_J": 9.0, "E_V": 9.5})
    return folder


def test_a_row_is_the_mean_and_the_sample_deviation_over_its_seeds(
    sweep: Path, tmp_path: Path
) -> None:
    """20, 22, 24: mean 22, deviation √((4 + 0 + 4) / 2) = 2."""
    report(report_config(sweep, tmp_path / "out"))
    line = lines_of(tmp_path / "out")["1 No Knowledge"]
    assert number(line["E_J_mean"]) == pytest.approx(22.0)
    assert number(line["E_J_sd"]) == pytest.approx(2.0)
    assert number(line["E_J_paper"]) == 22.4
    assert line["seeds"] == "0 1 2"
    assert lines_of(tmp_path / "out")["4 +Physics"]["E_J_sd"] == ""


def test_a_change_is_from_the_row_above_and_needs_that_row(sweep: Path, tmp_path: Path) -> None:
    """22 to 11 mm is −11 mm, half; 40 to 10 % is −30 points; row 4 has no row 3 above it."""
    report(report_config(sweep, tmp_path / "out"))
    lines = lines_of(tmp_path / "out")
    assert number(lines["2 +Biomechanics"]["E_J_change"]) == pytest.approx(-11.0)
    assert number(lines["2 +Biomechanics"]["E_J_change_percent"]) == pytest.approx(-50.0)
    assert lines["4 +Physics"]["E_J_change"] == ""
    text = (tmp_path / "out" / "table1.md").read_text()
    assert "−11.00 (−50 %)" in text
    assert "−30.0 points" in text


def test_what_was_not_run_or_measured_is_a_dash(sweep: Path, tmp_path: Path) -> None:
    report(report_config(sweep, tmp_path / "out"))
    text = (tmp_path / "out" / "table1.md").read_text()
    third = next(line for line in text.splitlines() if line.startswith("| 3 ++F-Anatomy"))
    cells = [cell.strip() for cell in third.strip("|").split("|")]
    assert cells == [
        "3 ++F-Anatomy", "✓", "✓", "", "", "9.6", "–", "–", "10.0", "–", "–", "11.4", "–", "–", "–",
    ]  # fmt: skip


def test_the_bootstrap_is_over_hands_paired_and_repeatable(sweep: Path, tmp_path: Path) -> None:
    """Every hand improves by exactly 11 mm: the paired interval has no width, though each row's own has."""
    report(report_config(sweep, tmp_path / "a"))
    report(report_config(sweep, tmp_path / "b"))
    line = lines_of(tmp_path / "a")["2 +Biomechanics"]
    low, high = number(line["E_J_low"]), number(line["E_J_high"])
    assert low is not None
    assert high is not None
    assert 8.0 <= low < 11.0 < high <= 14.0
    assert number(line["E_J_change_low"]) == pytest.approx(-11.0)
    assert number(line["E_J_change_high"]) == pytest.approx(-11.0)
    assert lines_of(tmp_path / "a") == lines_of(tmp_path / "b")
    assert lines_of(tmp_path / "a")["4 +Physics"]["E_J_low"] == ""


def test_the_page_opens_offline_and_says_whose_numbers_are_whose(
    sweep: Path, tmp_path: Path
) -> None:
    report(report_config(sweep, tmp_path / "out"))
    page = (tmp_path / "out" / "table1.html").read_text()
    assert "data:image/png;base64," in page
    assert "http" not in page
    for text in (page, (tmp_path / "out" / "table1.md").read_text()):
        assert "FreiHAND with MANO" in text
        assert "synthetic easy, 12000 training hands" in text
        assert "mean pose" in text
        assert "Not better than the mean pose in E_J: 1 No Knowledge." in text
    assert (tmp_path / "out" / "table1.png").stat().st_size > 1000


def test_runs_that_cannot_be_counted_are_named_with_the_reason(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (sweep / "8_unfinished").mkdir()
    (sweep / "8_unfinished" / "config.yaml").write_text("name: ablation_row5\n")
    broken = write_run(sweep / "9_broken", settings(5, 0), {"E_J": 8.0})
    (broken / "metrics.json").write_text("{")
    evaluation = write_run(sweep / "10_evaluation", settings(5, 1), {"E_J": 8.0})
    (evaluation / "config.yaml").unlink()
    empty = write_run(sweep / "11_empty", settings(5, 2), {"E_J": float("nan")})
    told = report(report_config(sweep, tmp_path / "out"))["left_out"]
    assert told[str(sweep / "8_unfinished")].startswith("unfinished")
    assert told[str(broken)].startswith("unreadable")
    assert "evaluation" in told[str(evaluation)]
    assert "no test scores" in told[str(empty)]
    shown = capsys.readouterr().out
    assert "9_broken: unreadable" in shown
    assert "8_unfinished</code>: unfinished" in (tmp_path / "out" / "table1.html").read_text()


def test_a_run_with_the_settings_of_version_0_1_is_left_out(sweep: Path, tmp_path: Path) -> None:
    """Its prior had other names, so that its knowledge would be read as none."""
    config = settings(2, 7) | {
        "prior": {"_target_": "hand_recon.knowledge.prior.Prior", "range_of_motion": 20_000.0}
    }
    write_run(sweep / "old", config, {"E_J": 9.0})
    reasons = report(report_config(sweep, tmp_path / "out"))["left_out"]
    assert "hand_recon 0.1" in reasons[str(sweep / "old")]


def test_of_two_runs_with_one_seed_the_newer_counts(sweep: Path, tmp_path: Path) -> None:
    """The old row 4 says 9 mm, a repetition 7: the row is 7, not their mean, and the old one is named."""
    again = write_run(sweep / "again", settings(4, 0), {"E_J": 7.0})
    os.utime(sweep / "0_row4" / "metrics.json", (1e9, 1e9))
    told = report(report_config(sweep, tmp_path / "out"))
    assert number(lines_of(tmp_path / "out")["4 +Physics"]["E_J_mean"]) == 7.0
    assert str(again) in told["left_out"][str(sweep / "0_row4")]


@pytest.mark.parametrize(
    ("name", "value"),
    [("trainer.max_epochs", 20), ("model.encoder.backbone", "resnet50"), ("data.level", "hard")],
)
def test_another_budget_model_or_data_is_another_table(
    sweep: Path, tmp_path: Path, name: str, value: object
) -> None:
    write_run(sweep / "other", settings(3, 0, **{name: value}), {"E_J": 5.0})
    told = report(report_config(sweep, tmp_path / "out"))
    assert told["runs"] == [7, 1]
    text = (tmp_path / "out" / "table1.md").read_text()
    assert f"{name}={value}" in text
    assert (tmp_path / "out" / "table1_study2.png").is_file()


def test_other_experiments_follow_below_under_their_names(sweep: Path, tmp_path: Path) -> None:
    changed = settings(5, 0, name="table3b_full", **{"supervision.fraction": 1.0})
    write_run(sweep / "full_3d", changed, {"E_J": 6.0, "coverage_1sigma": 0.66})
    report(report_config(sweep, tmp_path / "out"))
    line = lines_of(tmp_path / "out")["table3b_full"]
    assert number(line["E_J_mean"]) == 6.0
    assert line["E_J_paper"] == ""
    assert [line[name] for name in KNOWLEDGE] == ["True"] * 4
    assert "0.660 |" in (tmp_path / "out" / "table1.md").read_text()


def test_a_sigma_that_nothing_trained_is_not_judged(sweep: Path, tmp_path: Path) -> None:
    write_run(sweep / "row3", settings(3, 0), {"E_J": 9.6, "coverage_1sigma": 0.123, "ROM": 5.0})
    report(report_config(sweep, tmp_path / "out"))
    text = (tmp_path / "out" / "table1.md").read_text()
    assert "0.123" not in text
    assert "5.0" in text


def test_a_sweep_over_one_rows_weight_leaves_the_row_with_the_others_weight(
    sweep: Path, tmp_path: Path
) -> None:
    for place, weight in enumerate((2000.0, 20_000.0)):
        changed = settings(3, 0, **{"prior.range_of_motion.weight": weight})
        write_run(sweep / f"weight{place}", changed, {"E_J": 30.0 - 10 * place})
    report(report_config(sweep, tmp_path / "out"))
    lines = lines_of(tmp_path / "out")
    assert number(lines["3 ++F-Anatomy"]["E_J_mean"]) == 20.0
    assert number(lines["ablation_row3 (prior.range_of_motion.weight=2000.0)"]["E_J_mean"]) == 30.0


def test_a_sweep_over_data_terms_leaves_row_five_with_the_papers(
    sweep: Path, tmp_path: Path
) -> None:
    for place, term in enumerate(
        ("RescaledSquaredError", "NegativeLogLikelihood", "LaplaceLikelihood")
    ):
        changed = settings(5, 0, **{"data_term._target_": f"hand_recon.uncertainty.{term}"})
        write_run(sweep / term, changed, {"E_J": 7.0 + place})
    report(report_config(sweep, tmp_path / "out"))
    lines = lines_of(tmp_path / "out")
    assert number(lines["5 +NLL"]["E_J_mean"]) == 8.0
    assert sum(label.startswith("ablation_row5 (") for label in lines) == 2


def test_without_a_place_the_newest_sweep_with_a_finished_run_is_taken(
    sweep: Path, tmp_path: Path
) -> None:
    write_run(sweep.parent / "2025-01-01_00-00-00" / "0", settings(5, 0), {"E_J": 1.0})
    (sweep.parent / "2026-09-09_00-00-00" / "0").mkdir(parents=True)
    (sweep.parent / "2026-09-09_00-00-00" / "0" / "config.yaml").write_text("name: x\n")
    told = report(report_config(None, tmp_path / "out", **{"paths.output": str(tmp_path)}))
    assert told["runs"] == [7]


def test_several_places_and_patterns_are_taken_together(sweep: Path, tmp_path: Path) -> None:
    places = [sweep / "*row1", sweep / "0_row2", sweep / "0_row2"]
    assert report(report_config(places, tmp_path / "out"))["runs"] == [4]


def test_nothing_is_overwritten_and_nothing_found_is_said(sweep: Path, tmp_path: Path) -> None:
    report(report_config(sweep, tmp_path / "out"))
    before = (tmp_path / "out" / "table1.md").read_bytes()
    with pytest.raises(FileExistsError, match=r"already holds table1\.md"):
        report(report_config(sweep, tmp_path / "out"))
    assert (tmp_path / "out" / "table1.md").read_bytes() == before
    with pytest.raises(FileNotFoundError, match="No run at"):
        report(report_config(tmp_path / "nowhere", tmp_path / "other"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="no finished run"):
        report(report_config(tmp_path / "empty", tmp_path / "other"))
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("row", TABLE_1, ids=lambda row: row.name)
def test_the_experiments_have_the_check_marks_of_the_papers_rows(row: PaperRow) -> None:
    config = composed(f"experiment={row.name}")
    method = {name: OmegaConf.to_container(config[name]) for name in ("prior", "data_term")}
    assert knowledge_of(flattened(method)) == row.knowledge
