"""Measurement of 3D error bars: fitted corrections, quantiles, errors from the root, the command."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from depth.sets import synthetic_views
from error_bars.correction import GROUPS, fit_correction, quantile
from error_bars.errors import MEASURED, Errors
from error_bars.tables import markdown
from hand_recon.hand.skeleton import LANDMARKS, ROOT_LANDMARK
from hand_recon.uncertainty.covariance_correction import CovarianceCorrection
from measure_error_bars import main

HANDS = 300


def known_correction() -> CovarianceCorrection:
    """Twice the σ, and 3 mm across and 8 mm along the line of sight."""
    return CovarianceCorrection(
        scale=torch.full((21,), 2.0, dtype=torch.float64),
        across=torch.full((21,), 0.003, dtype=torch.float64),
        depth=torch.full((21,), 0.008, dtype=torch.float64),
        factors=torch.ones(21, 3, dtype=torch.float64),
    )


def drawn(name: str = "drawn", hands: int = HANDS) -> Errors:
    """Errors from corrected covariances of 2 to 10 mm."""
    size = 0.002 * 5 ** torch.rand(hands, 21, 1, 1, dtype=torch.float64)
    root = size * torch.randn(hands, 21, 3, 3, dtype=torch.float64)
    origin = torch.tensor([0.1, 0.05, 0.5], dtype=torch.float64) + 0.05 * torch.randn(hands, 3)
    nothing = torch.zeros(hands, 21, 3, dtype=torch.float64)
    empty = Errors(name, nothing, root @ root.mT, origin, tuple(map(str, range(hands))))
    factor = torch.linalg.cholesky(empty.covariance(known_correction()))
    error = (factor @ torch.randn(hands, 21, 3, 1, dtype=torch.float64))[..., 0]
    return Errors(name, error, empty.laplace, origin, empty.groups)


def test_groups_have_every_landmark_once() -> None:
    assert sorted(name for group in GROUPS.values() for name in group) == sorted(LANDMARKS)


def test_a_fitted_correction_is_the_one_that_errors_were_drawn_with() -> None:
    for group in fit_correction([drawn(), drawn()]):
        assert group["scale"] == pytest.approx(2.0, rel=0.1), group["name"]
        assert group["across_mm"] == pytest.approx(3.0, rel=0.1), group["name"]
        assert group["depth_mm"] == pytest.approx(8.0, rel=0.1), group["name"]
        # A Gaussian's own quantiles.
        assert group["factors"] == pytest.approx([1.0, 1.0, 1.0], abs=0.12)


def test_a_fitted_correction_covers_errors_that_it_has_not_seen() -> None:
    correction = CovarianceCorrection.of_groups(fit_correction([drawn(), drawn()]))
    fresh = drawn()
    found = fresh.scores(fresh.covariance(correction))
    for level in (50, 80, 95):
        # 6,000 landmarks, and as many in the fit: four standard errors are 3.6 % at a half.
        assert 100 * found[f"coverage_3d_{level}"] == pytest.approx(level, abs=3.6)
    # Twice the σ and more is missing without it.
    assert fresh.scores(fresh.laplace)["coverage_3d_80"] < 0.4


def test_a_conformal_quantile_is_the_one_of_one_value_more() -> None:
    """The 80 % quantile of 9 values is the 8th, ⌈0.8 · 10⌉; 95 % would be the 10th, so it is the largest."""
    values = torch.tensor([5.0, 1, 9, 3, 7, 2, 8, 4, 6], dtype=torch.float64)
    assert quantile([values], 0.8) == 8.0
    assert quantile([values], 0.95) == 9.0


def test_sets_count_equally_whatever_their_size() -> None:
    """A thousand zeros and ten values from 1 to 10: half of the weight is in the zeros, and 0.75 at 5."""
    values = torch.arange(1.0, 11.0, dtype=torch.float64)
    assert quantile([torch.zeros(1000, dtype=torch.float64), values], 0.4) == 0.0
    assert quantile([torch.zeros(1000, dtype=torch.float64), values], 0.74) == 5.0


@pytest.mark.parametrize("share", [0.5, 0.8, 0.95])
def test_new_values_are_below_the_quantile_as_often_as_said(share: float) -> None:
    """Exchangeable values of a heavy tail: the expected share is ⌈level (n + 1)⌉ / (n + 1)."""
    random = np.random.default_rng(0)
    values = torch.from_numpy(random.standard_cauchy((4000, 20)))
    inside = [float(row[0]) <= quantile([row[1:]], share) for row in values]
    expected = math.ceil(share * 20) / 20
    assert np.mean(inside) == pytest.approx(expected, abs=4 * math.sqrt(0.25 / 4000))


def test_errors_are_from_the_root_and_the_root_is_not_counted() -> None:
    errors = drawn()
    broken = Errors("broken", errors.error.clone(), errors.laplace, errors.origin, errors.groups)
    broken.error[:, ROOT_LANDMARK] = 5.0
    assert ROOT_LANDMARK not in MEASURED
    assert broken.scores(errors.laplace) == errors.scores(errors.laplace)


def test_the_errors_of_a_set_are_those_of_its_fit(tmp_path: Path) -> None:
    hands = synthetic_views(4, tmp_path)
    found = Errors.of(hands, ("lifter=none",))
    assert found.error.shape == (4, 21, 3)
    # The root is where the hand's origin is, up to the label that the knuckle set has there.
    assert float(found.error[:, ROOT_LANDMARK].norm(dim=-1).max()) < 1e-6
    assert 0.001 < float(found.error.norm(dim=-1).mean()) < 0.05
    assert float(torch.linalg.eigvalsh(found.laplace).min()) > -1e-12
    with pytest.raises(ValueError, match="gives no covariances; expected a likelihood and a prior"):
        Errors.of(hands, ("lifter=none", "data_term=mse"))


def test_validation_views_are_others_than_test_views(tmp_path: Path) -> None:
    test, val = (synthetic_views(4, tmp_path, split=split) for split in ("test", "val"))
    assert not torch.equal(test.ground_truth, val.ground_truth)


def test_the_table_has_a_row_for_every_correction() -> None:
    lines = markdown([drawn()], {"laplace": None, "known": known_correction()}).splitlines()
    assert len({line.count("|") for line in lines}) == 1
    assert lines[2].startswith("| drawn (300) | laplace |")
    cells = [cell.strip() for cell in lines[3].split("|")[1:-1]]
    for cell, level in zip(cells[2:5], (50, 80, 95), strict=True):
        assert float(cell.split(" ")[0]) == pytest.approx(level, abs=3)
    assert cells[5] == ", ".join(cell.split(" ")[0] for cell in cells[2:5])


def test_the_command_fits_prints_and_writes_a_new_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--hands", "4", "--cache", str(tmp_path), "--fit", "--write", str(tmp_path / "t.json")]
    main(words)
    printed = capsys.readouterr().out
    assert printed.count("| synthetic (2) |") == 3
    table = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert [one["hands"] for one in table["corrections"]["synthetic"]["measured_on"]] == [4, 4]
    CovarianceCorrection.of_groups(table["corrections"]["synthetic"]["groups"])
    with pytest.raises(FileExistsError, match=r"t\.json exists and is not overwritten"):
        main(words)
