"""Lifters by name (the packaged one, a file, a run's folder or a checkpoint) and their starts of a fit."""

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from hand_recon.fitting.lift import carried_start, lifted_start
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.start import Start
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.lifter_file import SHIPPED, fingerprint, load_lifter

logger = logging.getLogger(__name__)

DEFAULT: Final = "default"
"""Name of the lifter of the package."""

NO_LIFTER: Final = (None, "none", "null", "")
"""Values of `lifter` that mean none, in any case."""

SUFFIX: Final = ".safetensors"
"""Ending of a lifter's file; everything else is a run's folder or a checkpoint."""


def names_lifter(name: str | None) -> bool:
    """True if a value of `lifter` names one."""
    return name is not None and name.lower() not in NO_LIFTER


def lifter_path(name: str) -> Path:
    """File or folder that a lifter's name stands for.

    Args:
        name: `default`, a safetensors file, a run's folder or a checkpoint.

    Raises:
        FileNotFoundError: There is none.
    """
    path = SHIPPED if name == DEFAULT else Path(name).expanduser()
    if not path.exists():
        raise FileNotFoundError(
            f"Found lifter={name}, which is no name of a lifter, and no such file. Give lifter=default (that "
            "of the package), none, a .safetensors file, a run's folder or a checkpoint."
        )
    return path


def load_named(name: str, hand: HandModel) -> Regressor:
    """Load a lifter with its own hand.

    Args:
        name: `default`, a safetensors file, a run's folder or a checkpoint.
        hand: The hand that is fitted, which is not built again if the lifter was trained for it.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is no lifter, is damaged, or was made for a hand that is not here.
    """
    path = lifter_path(name)
    if path.suffix == SUFFIX:
        return load_lifter(path, partial(_hand_of, hand))
    # Checkpoints need Lightning, which takes seconds to import.
    from hand_recon.runs.checkpoints import load_trained

    return load_trained(path, hand.landmark_set).module.regressor


def starts_of(regressor: Regressor, hand: HandModel) -> Callable[[Observation], Start]:
    """Function that gives a lifter's start for hands of a model; a note says if it is not the lifter's own.

    Args:
        regressor: The lifter.
        hand: The hand that is fitted; a copy of one shape has no note, since the model that it came from is
            fitted first.
    """
    own = regressor.hand
    if not same_hand(regressor, hand):
        if not hand.one_shape:
            logger.info(
                "The lifter was made for the hand %s. Its joint angles and rotation start the fit of the "
                "hand %s, its shape does not.",
                own.name, hand.name,
            )  # fmt: skip
        return partial(carried_start, hand.landmarks_only(), regressor, with_shape=False)
    if own.landmark_set != hand.landmark_set:
        return partial(carried_start, hand.landmarks_only(), regressor, with_shape=True)
    return partial(lifted_start, regressor)


def same_hand(regressor: Regressor, hand: HandModel) -> bool:
    """True if a lifter predicts this hand model, with this or another landmark set."""
    return regressor.hand is hand or fingerprint(regressor.hand) == fingerprint(hand)


def check_result(regressor: Regressor, hand: HandModel, name: str) -> None:
    """Check that a lifter's prediction can be the result of a fit.

    Raises:
        ValueError: It predicts another hand model.
    """
    if not same_hand(regressor, hand):
        raise ValueError(
            f"descent.steps=0 makes the prediction of lifter={name} the result, which is of the hand "
            f"{regressor.hand.name!r}; found {hand.name!r}. Use hand={regressor.hand.name}, a lifter that "
            "was trained for this hand, or more steps."
        )


def _hand_of(given: HandModel, wanted: str, landmark_set: str) -> HandModel | None:
    """The hand with a fingerprint and a landmark set: the given one, or the open hand."""
    if given.landmark_set == landmark_set and fingerprint(given) == wanted:
        return given
    hand = open_hand(landmark_set)
    return hand if fingerprint(hand) == wanted else None
