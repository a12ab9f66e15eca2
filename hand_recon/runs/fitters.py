"""Builds the fit that a configuration describes: its loss, its starts and its hand (Sec. 3.4)."""

from collections.abc import Callable
from functools import partial

from omegaconf import DictConfig

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.descent import fit as descend
from hand_recon.fitting.descent import with_possible_solver
from hand_recon.fitting.estimated import estimated_hands, estimated_start
from hand_recon.fitting.in_parts import Fitter
from hand_recon.fitting.lift import lift
from hand_recon.fitting.objective import Fitted, Objective
from hand_recon.fitting.observation import Observation, observed
from hand_recon.fitting.seen_pose import SeenPoseTerm
from hand_recon.fitting.start import Start
from hand_recon.hand.model import HandModel
from hand_recon.runs.configuration import build_prior, instantiate
from hand_recon.runs.lifters import check_result, load_named, names_lifter, starts_of
from hand_recon.runs.one_person import hands_of_person, one_person_fitter
from hand_recon.schema import HandBatch


def build_objective(config: DictConfig, hand: HandModel) -> Objective:
    """Build the loss of a fit.

    Args:
        config: `conf/fit.yaml` or `conf/predict.yaml` composed.
        hand: The hand to fit.

    Raises:
        ValueError: The data term needs correlations, which a fit cannot estimate; or the weight of a term is
            no number, 0 or more.
    """
    data_term = instantiate(config.data_term)
    if data_term.needs_correlation:
        raise ValueError(
            "Fitting is given each landmark's σ and cannot estimate correlations, which this data "
            "term needs. Use data_term=mse, mse_then_nll, laplace or mse_rescaled."
        )
    prior = build_prior(config.prior, hand)
    return Objective(hand, prior, data_term, seen_pose_term=_seen_pose_term(config))


def _seen_pose_term(config: DictConfig) -> SeenPoseTerm | None:
    """Term of the pose that the network of `ckpt` sees; None without a network, or with a weight of zero."""
    if config.get("ckpt") is None:
        return None
    term = SeenPoseTerm.of(config.seen_pose_weight)
    return term if term.weight else None


def fitter_of(
    config: DictConfig, hand: HandModel, landmarks: ImageLandmarks, fitter: Fitter | None = None
) -> Fitter:
    """Build the fit of some landmarks: that of any hands, or that of one person's (`same_person`).

    Args:
        config: `conf/fit.yaml` or `conf/predict.yaml` composed.
        hand: The hand to fit.
        landmarks: All hands; the shape of one person is estimated from them.
        fitter: The fit of any hands, if it is built already.

    Raises:
        ValueError: As of `build_fitter` and `one_person_fitter`.
    """
    fitter = fitter or build_fitter(config, hand)
    if not config.same_person:
        return fitter
    return one_person_fitter(
        fitter,
        partial(build_fitter, config),
        build_objective(config, hand),
        instantiate(config.descent),
        hands_of_person(landmarks),
        sigma_at_half_confidence=config.sigma_at_half_confidence,
    )


def build_fitter(config: DictConfig, hand: HandModel) -> Fitter:
    """Build the fit that a configuration describes.

    Args:
        config: `conf/fit.yaml` composed.
        hand: The hand to fit.

    Raises:
        ValueError: The data term needs correlations, which a fit cannot estimate; or no steps are asked for
            without a lifter or a checkpoint.
    """
    objective = build_objective(config, hand)
    descent = with_possible_solver(instantiate(config.descent), objective)
    of_network = config.get("ckpt") is not None
    if descent.steps == 0 and not names_lifter(config.lifter) and not of_network:
        raise ValueError(
            "Found descent.steps=0, which makes a lifter's prediction the result, and no lifter. Add "
            "lifter=default or a lifter of your own, or leave descent.steps out."
        )
    if descent.steps == 0 and of_network:
        return lambda batch: Fitted(estimated_hands(observed(batch), hand), {})
    if descent.steps == 0:
        regressor = load_named(config.lifter, hand)
        check_result(regressor, hand, config.lifter)
        return lambda batch: Fitted(
            lift(regressor, observed(batch, config.sigma_at_half_confidence), hand), {}
        )
    further = further_starts(config, hand)

    def run(batch: HandBatch) -> Fitted:
        return descend(
            observed(batch, config.sigma_at_half_confidence),
            objective,
            descent=descent,
            further=further,
        )

    return run


def further_starts(config: DictConfig, hand: HandModel) -> Callable[[Observation], Start] | None:
    """Function that makes one more start per hand: a network's estimate, or a lifter's; None without either.

    Args:
        config: `conf/fit.yaml` or `conf/predict.yaml` composed.
        hand: The hand to fit.
    """
    if config.get("ckpt") is not None:
        return partial(estimated_start, hand=hand.landmarks_only())
    if names_lifter(config.lifter):
        return starts_of(load_named(config.lifter, hand), hand)
    return None
