"""Builds a run's datamodule and Lightning module from its configuration."""

from functools import partial
from typing import Final

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue

from hand_recon.data.datamodule import HandDataModule
from hand_recon.evaluation.hand_scores import Scores
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.lifted import start_from_lifter
from hand_recon.runs.configuration import build_hand, build_prior, instantiate
from hand_recon.runs.lifters import load_named, names_lifter
from hand_recon.training.module import HandReconstruction
from hand_recon.uncertainty import DataTerm

SCORED_RANGES: Final = "literature"
"""Table of ranges for range violations: the same for every model, whatever its prior."""


def build_data(config: DictConfig) -> HandDataModule:
    """Build the datamodule of a run.

    Raises:
        ValueError: A mandatory value such as `data.root` was not given.
    """
    try:
        OmegaConf.to_container(config.data, resolve=True, throw_on_missing=True)
    except MissingMandatoryValue as error:
        raise ValueError(
            f"{str(error).splitlines()[0]}. Give it on the command line, for example "
            "`data=freihand data.root=/path/to/FreiHAND_pub_v2` or `data=landmarks data.train=labels.json`; "
            "data/README.md tells where each dataset comes from."
        ) from error
    data: HandDataModule = instantiate(config.data)
    return data


def build_module(config: DictConfig) -> HandReconstruction:
    """Build the Lightning module of a run, with fresh weights."""
    hand = build_hand(config)
    data_term: DataTerm = instantiate(config.data_term)
    optimizer = {key: value for key, value in config.optimizer.items() if key != "schedule"}
    regressor = instantiate(config.model, hand=hand, correlated=data_term.needs_correlation)
    start_from = config.get("start_from")
    if names_lifter(start_from):
        start_from_lifter(regressor, load_named(start_from, hand))
    return HandReconstruction(
        regressor,
        build_prior(config.prior, hand),
        data_term,
        scores=partial(Scores, load_ranges(SCORED_RANGES), NonPenetration(hand)),
        optimizer=instantiate(OmegaConf.create(optimizer)),
        scheduler=instantiate(config.optimizer.schedule),
        supervision=instantiate(config.get("supervision") or None),
        label_sigma=config.get("label_sigma", "learnt"),
        located_weight=config.get("located_weight", 20.0),
    )


def check_input(module: HandReconstruction, data: HandDataModule) -> None:
    """Check that a lifter gets data=views: it was trained on upright crops about the landmarks.

    Raises:
        ValueError: The model looks at landmarks, and the data are not views of upright landmarks.
    """
    lifts = isinstance(module.regressor.encoder, LandmarkEncoder)
    if lifts and data.name != "views":
        raise ValueError(
            f"A lifter is trained and scored on data=views, whose crops are cut about the landmarks with the "
            f"fingers up; {data.name}'s are not. For other landmarks use "
            "`python -m hand_recon.fit landmarks=<file> lifter=<run> descent.steps=0`."
        )
