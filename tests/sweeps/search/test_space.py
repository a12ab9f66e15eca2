"""Search spaces in YAML become Optuna's distributions, and their values Hydra's overrides."""

import pytest

from hand_recon.sweeps.search.space import distributions, overrides
from tests.support.configurations import composed

kinds = pytest.importorskip("optuna").distributions


def test_ranges_of_whole_numbers_and_of_others_and_choices() -> None:
    space = {
        "a.b": {"low": 1e-4, "high": 1e-2, "log": True},
        "c": {"low": 0, "high": 40, "step": 10},
        "d": {"choices": ["full", None, True]},
    }
    assert distributions(space) == {
        "a.b": kinds.FloatDistribution(1e-4, 1e-2, log=True),
        "c": kinds.IntDistribution(0, 40, step=10),
        "d": kinds.CategoricalDistribution(("full", None, True)),
    }


@pytest.mark.parametrize("given", [{"low": 1}, 3, {"low": 1, "high": 2, "chocies": [1]}, {}])
def test_a_setting_without_a_range_or_choices_is_refused(given: object) -> None:
    with pytest.raises(ValueError, match=r"search\.space has .* for lr; expected \{low, high\}"):
        distributions({"lr": given})
    with pytest.raises(ValueError, match="The search space is empty"):
        distributions({})


@pytest.mark.parametrize("name", ["learning_rate", "knowledge"])
def test_the_settings_of_the_spaces_in_conf_are_those_of_a_training(name: str) -> None:
    config = composed("recipe=lifter", f"search={name}", name="search")
    lowest = {key: one.low for key, one in distributions(dict(config.search.space)).items()}
    trained = composed("recipe=lifter", *overrides(lowest))
    for key, value in lowest.items():
        node = trained
        for part in key.split("."):
            node = node[part]
        assert node == value
