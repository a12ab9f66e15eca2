import logging
import math

import pytest
import torch

from hand_recon.data.datamodule import HandDataModule
from hand_recon.hand.model import HandModel
from hand_recon.inspection.ranges import examine_poses
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.schema import HandParameters
from tests.support.views import known_hands


class Known(HandDataModule):
    """Datamodule that returns parameters, or raises an error."""

    def __init__(self, answer: HandParameters | Exception | None) -> None:
        self.answer = answer

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


def test_hands_count_beyond_the_tolerance_and_the_mean_is_without_it(hand: HandModel) -> None:
    parameters = known_hands(hand, 4)
    ranges = load_ranges("literature", hand.rest_angles)
    angles = ((ranges.lower + ranges.upper) / 2).repeat(4, 1, 1)
    # The index PIP of three hands 10, 30 and 50 degrees too far; one hand is within its ranges.
    for row, degrees in enumerate((10, 30, 50)):
        angles[row, 4, 0] = ranges.upper[4, 0] + math.radians(degrees)
    parameters = HandParameters(**{**vars(parameters), "joint_angles": angles})
    found = examine_poses(Known(parameters), hand.rest_angles, 4)
    assert found == {
        "poses": 4.0,
        "beyond_ranges_percent": 50.0,
        "largest_violation_degrees_mean": pytest.approx(22.5, abs=1e-4),
    }
    # A hand without a pose is not counted.
    angles[0] = torch.nan
    assert examine_poses(Known(parameters), hand.rest_angles, 4)["poses"] == 3


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (None, "has no labelled poses"),
        (FileNotFoundError("MANO is missing."), "not compared with joint ranges: MANO is missing."),
        (ValueError("No such labels."), "not compared with joint ranges: No such labels."),
    ],
)
def test_what_cannot_be_had_is_said_in_a_line(
    hand: HandModel,
    caplog: pytest.LogCaptureFixture,
    answer: Exception | None,
    said: str,
) -> None:
    with caplog.at_level(logging.INFO):
        assert examine_poses(Known(answer), hand.rest_angles, 4) == {}
    assert said in caplog.text
