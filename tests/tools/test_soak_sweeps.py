"""A sweep with failing and killed members, run again: nothing is lost and nothing is done twice."""

from pathlib import Path

import pytest

from soak_sweeps import soak


@pytest.mark.slow
def test_members_that_were_killed_go_on_exactly_and_finished_ones_are_skipped(
    tmp_path: Path,
) -> None:
    assert soak(tmp_path)
