"""Correction of 3D covariances: values by hand, its inverse, rotations of the camera, the shipped table."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from hand_recon.hand.axis_angle import axis_angle_to_rotation
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.uncertainty.covariance_correction import (
    LAPLACE,
    LEVELS,
    TABLE,
    CovarianceCorrection,
    correction_named,
)
from tests.support.tolerance import assert_close


def groups(landmarks: Sequence[str] = ("wrist",)) -> list[dict[str, Any]]:
    """A table of two groups: the wrist, and all others."""
    own = {"scale": 2.0, "across_mm": 3.0, "depth_mm": 6.0, "factors": [0.5, 1.0, 1.5]}
    others = {"scale": 1.0, "across_mm": 0.0, "depth_mm": 0.0, "factors": [1.0, 1.0, 1.0]}
    return [
        {"landmarks": list(landmarks), **own},
        {"landmarks": list(LANDMARKS[1:]), **others},
    ]


def some_covariances(count: int = 3) -> tuple[Tensor, Tensor]:
    """Covariances of about 1 cm, and origins before a camera."""
    root = 0.01 * torch.randn(count, 21, 3, 3, dtype=torch.float64)
    origin = torch.tensor([[0.3, -0.2, 0.6], [0.0, 0.0, 0.5], [-1.0, 0.4, 1.0]])
    return root @ root.mT, origin[:count].double()


def test_the_correction_agrees_with_a_calculation_by_hand() -> None:
    """On the optical axis 2² · 1e-4 plus 3 mm across, 6 mm along; other landmarks keep theirs."""
    correction = CovarianceCorrection.of_groups(groups())
    laplace = 1e-4 * torch.eye(3, dtype=torch.float64).expand(1, 21, 3, 3)
    found = correction(laplace, torch.tensor([[0.0, 0.0, 0.7]], dtype=torch.float64))
    expected = torch.diag(torch.tensor([4.09e-4, 4.09e-4, 4.36e-4], dtype=torch.float64))
    assert_close(found[0, 0], expected)
    assert_close(found[0, 1:], laplace[0, 1:])


def test_what_is_added_in_depth_lies_along_the_line_of_sight() -> None:
    """Towards (3, 0, 4) / 5, the variance is 36 mm² along it, 9 mm² along y and (4, 0, −3) / 5."""
    correction = CovarianceCorrection.of_groups(groups())
    nothing = torch.zeros(1, 21, 3, 3, dtype=torch.float64)
    found = 1e6 * correction(nothing, torch.tensor([[0.3, 0.0, 0.4]], dtype=torch.float64))[0, 0]
    directions = torch.tensor([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [0.8, 0.0, -0.6]]).double()
    assert_close(directions @ found @ directions.mT, torch.diag(torch.tensor([36.0, 9.0, 9.0])))


def test_laplaces_covariances_are_recovered() -> None:
    correction = correction_named("living")
    assert correction is not None
    laplace, origin = some_covariances()
    assert_close(correction.laplace_of(correction(laplace, origin), origin), laplace)


def test_a_rotated_camera_rotates_the_corrected_covariances() -> None:
    correction = correction_named("living")
    assert correction is not None
    laplace, origin = some_covariances()
    rotation = axis_angle_to_rotation(torch.tensor([0.3, -0.5, 1.1], dtype=torch.float64))
    rotated = correction(rotation @ laplace @ rotation.mT, origin @ rotation.mT)
    assert_close(rotated, rotation @ correction(laplace, origin) @ rotation.mT)


def test_regions_are_scaled_by_the_factor_of_their_level() -> None:
    correction = CovarianceCorrection.of_groups(groups())
    covariance, _ = some_covariances()
    for level, factor in zip(LEVELS, (0.5, 1.0, 1.5), strict=True):
        region = correction.region(covariance, level)
        assert_close(region[:, 0], factor * covariance[:, 0])
        assert_close(region[:, 1:], covariance[:, 1:])
    with pytest.raises(
        ValueError, match=r"Found the level 0\.9; expected one of 0\.5, 0\.8, 0\.95"
    ):
        correction.region(covariance, 0.9)


def test_laplace_is_without_a_correction_and_other_names_are_refused() -> None:
    assert correction_named(LAPLACE) is None
    with pytest.raises(
        ValueError, match="Found error_bars=true; expected one of living, synthetic, lap"
    ):
        correction_named("true")


@pytest.mark.parametrize("landmarks", [[], ["wrist", "index tip"]])
def test_a_table_needs_every_landmark_once(landmarks: list[str]) -> None:
    with pytest.raises(
        ValueError, match="in the groups of a correction; expected each of the 21 once"
    ):
        CovarianceCorrection.of_groups(groups(landmarks))


def test_the_shipped_table_names_what_it_was_measured_on() -> None:
    """More is added in depth than across, and farther out more; ellipsoids lie in each other."""
    table = json.loads(Path(TABLE).read_text(encoding="utf-8"))
    assert table["command"].startswith("python tools/measure_error_bars.py")
    assert set(table["corrections"]) == {"living", "synthetic"}
    for name, entry in table["corrections"].items():
        assert all(one["hands"] >= 200 for one in entry["measured_on"])
        correction = correction_named(name)
        assert correction is not None
        assert (correction.depth > correction.across).all()
        assert correction.depth[LANDMARKS.index("index tip")] > 0.005
        assert (correction.depth[[8, 12, 16, 20]] > correction.depth[[5, 9, 13, 17]]).all()
        assert_close(correction.factors[:, 1], torch.ones(21))
        # The ellipsoid of a larger share holds that of a smaller one: 2.37, 4.64, 7.81 are quantiles of χ².
        assert ((correction.factors * torch.tensor([2.37, 4.64, 7.81])).diff() > 0).all()
