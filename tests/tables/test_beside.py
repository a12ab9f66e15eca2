"""Tables 2 and 3: the paper's printed numbers, our runs below the rows they reproduce, and differences."""

import contextlib
import csv
import json
from pathlib import Path
from typing import Any

import pytest
from hydra import initialize_config_dir
from omegaconf import OmegaConf

from hand_recon.command_line.configuration_files import CONF
from hand_recon.runs.tables_run import report
from hand_recon.tables.conditions import differences, paper_settings
from hand_recon.tables.published import TABLE_3A, TABLE_3B, TABLES_2
from hand_recon.tables.runs import flattened
from tests.support.runs_on_disk import report_config, write_run

PAPERS: dict[str, Any] = {
    "crop_size": 224,
    "hand": {"_target_": "hand_recon.hand.mano.hand.mano_hand"},
    "model": {
        "encoder": {
            "_target_": "hand_recon.regressor.image_encoder.ImageEncoder", "backbone": "resnet50"
        }
    },
    "trainer": {"max_epochs": 200},
    "data": {"batch_size": 64},
    "optimizer": {"_target_": "torch.optim.Adam", "lr": 1e-5, "weight_decay": 1e-4},
    "prior": {
        "range_of_motion": {
            "weight": 20_000.0,
            "anatomy": {
                "_target_": "hand_recon.knowledge.functional_anatomy.FunctionalAnatomy",
                "variant": "paper",
            },
        },
        "non_penetration": {"weight": 20_000.0},
        "shape": {"weight": 10.0},
    },
    "data_term": {
        "_target_": "hand_recon.uncertainty.Staged",
        "first": {"_target_": "hand_recon.uncertainty.SquaredError"},
        "second": {"_target_": "hand_recon.uncertainty.NegativeLogLikelihood", "beta": 0.0},
    },
}  # fmt: skip
"""Configuration of a run with the paper's settings, as far as these tests need it."""

ADVERSARIAL = {
    "prior.range_of_motion": None, "prior.non_penetration": None,
    "prior.adversarial.weight": 1000.0,
}  # fmt: skip


def settings(name: str, seed: int = 0, /, **changes: object) -> dict[str, Any]:
    config = OmegaConf.create({**PAPERS, "name": name, "seed": seed})
    for key, value in changes.items():
        OmegaConf.update(config, key, value, force_add=True)
    return dict(OmegaConf.to_container(config))  # type: ignore[arg-type]  # a mapping


def run(
    folder: Path, config: dict[str, Any], test: dict[str, float], data: str, hands: int = 3960
) -> Path:
    written = write_run(folder, config, test)
    metrics = json.loads((written / "metrics.json").read_text())
    metrics |= {"data": data, "test_hands": hands}
    (written / "metrics.json").write_text(json.dumps(metrics))
    return written


def lines(output: Path, table: str) -> list[dict[str, str]]:
    with (output / "tables2_3.csv").open(newline="") as stream:
        return [line for line in csv.DictReader(stream) if line["table"] == table]


def test_the_published_numbers_are_the_papers() -> None:
    """Numbers typed a second time from the paper's LaTeX source, row by row."""
    printed = {
        "Boukhayma": ((11.0, 10.9), (None, 27.3), (None,) * 4),
        "Spurr": ((11.3, None), (7.1, None), (None,) * 4),
        "Chen": ((11.8, 11.9), (None, None), (11.5, 0.769, 11.1, 0.778)),
        "Ren": ((10.7, 11.0), (None, None), (None,) * 4),
        "Jiang": ((10.8, 10.9), (None, None), (10.5, 0.789, 10.7, 0.785)),
        "the paper": ((8.5, 8.9), (6.7, 22.0), (10.0, 0.800, 9.8, 0.804)),
    }
    columns = (("E_J", "E_V"), ("E_J", "E_RV"), ("E_J", "AUC_J", "E_V", "AUC_V"))
    for column, (table, names) in enumerate(zip(TABLES_2, columns, strict=True)):
        assert table.scores == names
        expected = {
            who: known
            for who, scores in printed.items()
            if (
                known := {n: v for n, v in zip(names, scores[column], strict=True) if v is not None}
            )
        }
        found = {row.label.split(" et al.")[0]: row.scores for row in table.rows}
        assert found == expected
    assert [list(row.scores.values()) for row in TABLE_3A.rows] == [[8.3, 8.5], [6.7, 7.1]]
    assert [list(row.scores.values()) for row in TABLE_3B.rows] == [
        [8.30, 8.4, 21.5], [8.52, 8.9, 18.4], [8.26, 8.6, 16.9],
    ]  # fmt: skip


def test_methods_with_an_asterisk_learn_from_3d() -> None:
    learnt = {row.label.split(" et al.")[0]: row.learns_from for row in TABLES_2[0].rows}
    assert [who for who, labels in learnt.items() if "3D" in labels] == ["Boukhayma", "Spurr"]


def test_a_run_with_the_papers_settings_stands_below_its_row_without_a_difference(
    tmp_path: Path,
) -> None:
    for seed, error in enumerate((8.0, 9.0)):
        config = settings("table2_freihand", seed)
        run(tmp_path / f"runs/{seed}", config, {"E_J": error, "E_V": 9.5}, "freihand")
    found = report(report_config(tmp_path / "runs", tmp_path / "out"))
    assert found["tables"] == ["Table 2: FreiHAND"]
    table = lines(tmp_path / "out", "2_freihand")
    assert [line["source"] for line in table] == ["paper"] * 6 + ["ours"]
    ours = table[-1]
    assert (float(ours["E_J_mean"]), ours["seeds"], ours["differs"]) == (8.5, "0 1", "")
    assert float(ours["E_J_sd"]) == pytest.approx(0.5**0.5)
    text = (tmp_path / "out" / "table1.md").read_text()
    row = next(line for line in text.splitlines() if line.startswith("| ours, table2_freihand"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1:] == ["2D", "8.50 ± 0.71", "9.50 ± 0.00", "2", "none"]


@pytest.mark.parametrize(
    ("changes", "hands", "words"),
    [
        ({"model.encoder.backbone": "resnet18"}, 3960, "resnet18"),
        ({"trainer.max_epochs": 20}, 3960, "20 epochs"),
        ({"crop_size": 64}, 3960, "64 px"),
        ({"hand._target_": "hand_recon.hand.open_hand.open_hand"}, 3960, "open hand"),
        ({}, 3256, "3256 test hands, not FreiHAND's 3960"),
        ({"data.batch_size": 32}, 3960, "batches of 32"),
        ({"optimizer._target_": "torch.optim.AdamW"}, 3960, "AdamW"),
        ({"optimizer.lr": 1e-3}, 3960, "learning rate 0.001"),
        ({"trainer.limit_train_batches": 8}, 3960, "trainer.limit_train_batches=8"),
        ({"data.partial": True}, 3960, "data.partial=True"),
        ({"prior.non_penetration.weight": 0.0}, 3960, "prior.non_penetration.weight=0.0"),
        ({"prior.non_penetration": None}, 3960, "prior.non_penetration.weight=0.0"),
        ({"prior.range_of_motion.anatomy": None}, 3960, "prior.range_of_motion.anatomy=None"),
        ({"prior.pose_components.weight": 10.0}, 3960, "prior.pose_components.weight=10.0"),
        ({"supervision.fraction": 0.5}, 3960, "3D labels of 50 %"),
        ({"data_term.second.beta": 0.5}, 3960, "another data term than MSE, then NLL"),
    ],
)
def test_each_other_condition_is_named_alone(
    tmp_path: Path, changes: dict[str, object], hands: int, words: str
) -> None:
    config = settings("anything", **changes)
    run(tmp_path / "runs/a", config, {"E_J": 8.0}, "freihand", hands)
    report(report_config(tmp_path / "runs", tmp_path / "out"))
    ours = lines(tmp_path / "out", "2_freihand")[-1]
    assert (ours["method"], ours["differs"]) == ("ours, anything", words)


def test_the_weights_of_section_4_1_are_read_inside_and_outside_a_command() -> None:
    weights = {"range_of_motion": 20_000.0, "non_penetration": 20_000.0, "shape": 10.0}
    expected = {f"prior.{name}.weight": str(weight) for name, weight in weights.items()}
    for context in (initialize_config_dir(CONF, version_base="1.3"), contextlib.nullcontext()):
        paper_settings.cache_clear()
        with context:
            assert expected.items() <= paper_settings().items()


def test_what_was_not_recorded_is_unknown_rather_than_equal() -> None:
    config = flattened(settings("x")) | {"data": "freihand", "test_hands": "3960"}
    assert differences(config, "freihand", "table2_freihand") == ()
    for key, words in (
        ("trainer.max_epochs", "unknown epochs"), ("optimizer.lr", "learning rate unknown"),
        ("model.encoder.backbone", "unknown backbone"), ("hand._target_", "hand"),
        ("test_hands", "unknown number of test hands, not FreiHAND's 3960"),
        ("prior.shape.weight", "prior.shape.weight=unknown"),
    ):  # fmt: skip
        without = {name: value for name, value in config.items() if name != key}
        assert len(differences(without, "freihand", "table2_freihand")) == 1, key
        if key != "trainer.max_epochs":
            assert differences(without, "freihand", "table2_freihand") == (words,)
    assert differences({"data": "views"}, "freihand", "table2_freihand") == (
        "all settings but its name are unknown",
    )


def test_runs_on_other_data_are_in_no_table_2(tmp_path: Path) -> None:
    config = settings("ablation_row5")
    run(tmp_path / "runs/a", config, {"E_J": 8.0}, "synthetic", 1000)
    assert report(report_config(tmp_path / "runs", tmp_path / "out"))["tables"] == []
    assert not (tmp_path / "out" / "tables2_3.csv").exists()
    assert "Table 2" not in (tmp_path / "out" / "table1.md").read_text()


def test_priors_on_synthetic_views_stand_beside_the_papers_and_say_where_they_are_from(
    tmp_path: Path,
) -> None:
    """Runs are recognised by their settings; other priors and data terms are in no table."""
    lifter = {
        "model.encoder": {"_target_": "hand_recon.regressor.landmark_encoder.LandmarkEncoder"},
        "data.level": "hard",
        "trainer.max_epochs": 10,
    }  # fmt: skip
    for name, changes, error in (
        ("adversarial", ADVERSARIAL, 11.0), ("full", {}, 9.0), ("flat", {"prior.shape.weight": 0.0}, 8.0),
        ("beta", {"data_term.second.beta": 0.5}, 7.0)
    ):  # fmt: skip
        config = settings(name, **lifter, **changes)
        run(tmp_path / "runs" / name, config, {"E_J": error}, "views", 1000)
    found = report(report_config(tmp_path / "runs", tmp_path / "out"))
    assert found["tables"] == ["Table 3 (a): knowledge against a prior from 3D data, on DexYCB"]
    table = lines(tmp_path / "out", "3a")
    assert [(line["method"], line["E_J_mean"]) for line in table] == [
        ("FreiHAND-3D", "8.3"), ("ours, adversarial", "11.0"), ("the paper", "6.7"),
        ("ours, full", "9.0"),
    ]  # fmt: skip
    views = "on views hard; 2D landmarks in place of images; 10 epochs"
    assert table[1]["differs"] == f"{views}; real hands of other data than FreiHAND"
    assert table[3]["differs"] == views
    page = (tmp_path / "out" / "table1.html").read_text()
    assert views in page
    assert "FreiHAND-3D" in page


def test_the_discriminator_of_the_paper_has_seen_freihand(tmp_path: Path) -> None:
    source = {
        "prior.adversarial.real._target_": "hand_recon.data.freihand.datamodule.FreiHandDataModule"
    }
    for name, more in (("table3a_adversarial", source), ("own_hands", {})):
        config = settings(name, **ADVERSARIAL, **more)
        run(tmp_path / "runs" / name, config, {"E_J": 8.0}, "dexycb", 78_000)
    report(report_config(tmp_path / "runs", tmp_path / "out"))
    differs = {line["method"]: line["differs"] for line in lines(tmp_path / "out", "3a")}
    assert differs["ours, table3a_adversarial"] == ""
    assert differs["ours, own_hands"] == "real hands of other data than FreiHAND"
    # In Table 2, where knowledge is the prior, the same run is another method.
    other = {line["method"]: line["differs"] for line in lines(tmp_path / "out", "2_dexycb")}
    assert "prior.adversarial.weight=1000.0" in other["ours, table3a_adversarial"]


def test_shares_of_3d_labels_stand_below_the_share_that_they_repeat(tmp_path: Path) -> None:
    without = {"prior.range_of_motion": None, "prior.non_penetration": None}
    for name, changes in (
        ("table3b_0", {}), ("table3b_10", {"supervision.fraction": 0.1}),
        ("table3b_100", {"supervision.fraction": 1.0, **without}),
        ("full_and_knowledge", {"supervision.fraction": 1.0}),
        ("a_fifth", {"supervision.fraction": 0.2}),
    ):  # fmt: skip
        config = settings(name, **changes)
        run(tmp_path / "runs" / name, config, {"E_J": 8.0, "E_RV": 20.0}, "freihand")
    report(report_config(tmp_path / "runs", tmp_path / "out"))
    table = lines(tmp_path / "out", "3b")
    assert [(line["method"], line["differs"]) for line in table if line["source"] == "ours"] == [
        ("ours, table3b_100", ""),
        ("ours, full_and_knowledge", "prior.range_of_motion.weight=20000.0; "
                                     "prior.range_of_motion.anatomy=FunctionalAnatomy; "
                                     "prior.non_penetration.weight=20000.0"),
        ("ours, table3b_0", ""),
        ("ours, table3b_10", ""),
        ("ours, a_fifth", "3D labels of 20 %"),
    ]  # fmt: skip
    assert table[-1]["learns_from"] == "2D and 3D of 20 %"
    # As many decimals as the paper prints: two for E_J, one for the others.
    text = (tmp_path / "out" / "table1.md").read_text()
    row = next(line for line in text.splitlines() if line.startswith("| the paper, 0 %"))
    assert [cell.strip() for cell in row.split("|")][3:6] == ["8.52", "8.9", "18.4"]
    assert table[-1]["E_RV_mean"] == "20.0"


def test_a_study_without_a_row_of_table_1_does_not_show_the_papers_five(tmp_path: Path) -> None:
    config = settings("table2_ho3d")
    run(tmp_path / "runs/a", config, {"E_J": 8.0, "AUC_J": 0.8}, "ho3d", 20_137)
    report(report_config(tmp_path / "runs", tmp_path / "out"))
    text = (tmp_path / "out" / "table1.md").read_text()
    assert "No Knowledge" not in text
    assert "Experiments that Table 1 does not have" in text
    assert "0.800" in text
    assert "from the benchmark's server" in text
