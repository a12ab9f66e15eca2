"""Starts that know how hands bend are beside priors that know it too, unless the command says otherwise."""

import pytest

from hand_recon.runs.configuration import instantiate
from tests.support.configurations import composed


@pytest.mark.parametrize("command", ["fit", "predict"])
@pytest.mark.parametrize(
    ("prior", "knows"),
    [
        ("none", False),
        ("biomechanics", False),
        ("functional_anatomy", False),
        ("pca_mean", False),
        ("ranges_only", False),
        ("full", True),
        ("natural", True),
    ],
)
def test_the_table_of_finger_poses_and_the_lifter_follow_the_prior(
    command: str, prior: str, knows: bool
) -> None:
    words = ["input=[a.jpg]"] if command == "predict" else []
    config = composed(*words, f"prior={prior}", name=command)
    assert instantiate(config.descent).finger_table is knows
    assert config.lifter == ("default" if knows else "none")


def test_a_prior_without_one_of_its_terms_does_not_know_all() -> None:
    config = composed("prior=full", "prior.non_penetration=null", name="fit")
    assert instantiate(config.descent).finger_table is False


def test_the_command_has_the_last_word() -> None:
    config = composed("prior=none", "descent.finger_table=true", "lifter=default", name="fit")
    assert instantiate(config.descent).finger_table is True
    assert config.lifter == "default"
