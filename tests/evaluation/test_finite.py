import pytest
import torch

from hand_recon.evaluation.finite import require_finite


def test_finite_numbers_whose_sum_is_infinite_pass() -> None:
    require_finite("vertices", torch.full((4, 3, 3), 3e38), torch.arange(4))
    require_finite("vertices", torch.empty(0, 3, 3), torch.arange(0))


@pytest.mark.parametrize("value", [torch.nan, torch.inf, -torch.inf])
def test_the_first_ten_samples_that_are_not_finite_are_named(value: float) -> None:
    values = torch.zeros(20, 3)
    values[4:16, 1] = value
    # Infinities of both signs have no sum.
    values[5, 0] = -value
    with pytest.raises(
        ValueError, match=r"predicted angles of the samples 104, .*, 113 and 2 more"
    ):
        require_finite("angles", values, 100 + torch.arange(20))
