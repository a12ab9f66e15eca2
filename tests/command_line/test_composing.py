"""Configurations compose inside programs that have a Hydra of their own."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra

from hand_recon.command_line.composing import composed
from hand_recon.command_line.configuration_files import CONF
from hand_recon.runs.fit_run import adapted_to_data


def test_hydra_of_the_surrounding_program_stays_as_it_was() -> None:
    with initialize_config_dir(CONF, version_base="1.3"):
        outer = compose("doctor")
        assert composed("fit", ["prior=none"]).prior.range_of_motion is None
        assert GlobalHydra.instance().is_initialized()
        assert compose("doctor") == outer
    assert not GlobalHydra.instance().is_initialized()


def test_threads_may_compose_at_once() -> None:
    with ThreadPoolExecutor(4) as pool:
        steps = list(
            pool.map(lambda k: composed("fit", [f"descent.steps={k}"]).descent.steps, range(12))
        )
    assert steps == list(range(12))


@pytest.mark.parametrize(
    ("words", "landmark_set"),
    [([], "mediapipe"), (["hand=open"], "mediapipe"), (["hand=mano"], "mano"),
     (["hand=mano", "landmark_set=dexycb"], "dexycb"), (["landmark_set=knuckle"], "knuckle")],
)  # fmt: skip
def test_the_landmarks_of_fit_and_predict_follow_the_hand(
    words: list[str], landmark_set: str
) -> None:
    for name, more in (("fit", []), ("predict", ["input=[]"])):
        config = composed(name, [*more, *words])
        assert config.landmark_set == landmark_set
        assert adapted_to_data(config).hand.landmark_set == landmark_set
