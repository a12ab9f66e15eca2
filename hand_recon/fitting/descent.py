"""Fit of hands to 2D landmarks: minimizes the training's loss from several starts (Sec. 3.4)."""

import copy
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import torch

from hand_recon.fitting.adam_unknowns import AdamUnknowns
from hand_recon.fitting.objective import Fitted, Objective
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.second_order.minima import Minima
from hand_recon.fitting.second_order.prior_terms import without_second_derivatives
from hand_recon.fitting.second_order.solver import ROUNDS, Round, SecondOrder
from hand_recon.fitting.start import Start, closed_form_starts
from hand_recon.hand.model import HandModel
from hand_recon.schema import HandPrediction
from hand_recon.uncertainty import DataTerm
from hand_recon.uncertainty.covariance_correction import correction_named

logger = logging.getLogger(__name__)

SOLVERS: Final = ("second_order", "adam")
"""Values of `Descent.solver`."""


@dataclass(frozen=True)
class Descent:
    """Settings of the optimizer.

    Raises:
        ValueError: The solver or the correction of covariances is unknown.
    """

    solver: str = "second_order"
    """`second_order` (Levenberg–Marquardt) or `adam`, which takes ten to thirty times as long."""
    starts: int = 4
    """Closed-form placements of the palm per hand; the second-order solver tries fingers in two ways each."""
    finger_table: bool = True
    """True if the second-order solver looks the fingers of its starts up in a table of natural poses. The
    table is knowledge of hands: a fit without knowledge must not have it."""
    steps: int = 300
    """Steps of Adam."""
    learning_rate: float = 0.1
    """Adam's learning rate at the first step, radians for joint angles; it falls to zero as a cosine."""
    non_penetration_from: float = 0.6
    """Share of the steps without the non-penetration term. After them the start of smallest loss is kept.

    Before, poses are far from final, and a finger must be able to pass through another."""
    hands_at_once: int = 256
    """Hands times starts in one batch; batches that fit the processor's cache are fastest."""
    error_bars: str = "living"
    """Correction of the landmarks' covariances: `living`, `synthetic` or `laplace` for none (decision 83)."""

    def __post_init__(self) -> None:
        """Refuse an unknown solver or correction."""
        correction_named(self.error_bars)
        if self.solver not in SOLVERS:
            raise ValueError(
                f"Found descent.solver={self.solver}; expected one of {', '.join(SOLVERS)}."
            )


def fit(
    observation: Observation,
    objective: Objective,
    *,
    descent: Descent,
    further: Callable[[Observation], Start] | None = None,
) -> Fitted:
    """Fit every hand to its landmarks.

    Args:
        observation: The landmarks.
        objective: The loss to minimize.
        descent: Settings of the optimizer.
        further: Function that makes more starts per hand, such as a lifter's prediction.

    Raises:
        ValueError: `descent.starts` is 0 and `further` is None.
    """
    if not descent.starts and further is None:
        raise ValueError(
            "Found descent.starts=0 and no lifter; expected one start or more per hand. Set descent.starts "
            "to 1, 2, 3 or 4, or give a lifter."
        )
    size = max(1, descent.hands_at_once // max(descent.starts, 1))
    fit_piece = _solver(observation, objective, descent)
    pieces = []
    # One batch even without a hand, such as for a part of a video in which none was detected.
    for first in range(0, max(len(observation), 1), size):
        piece = observation[first : first + size]
        palms = _closed_form(piece, objective.hand, descent.starts) if descent.starts else None
        pieces.append(fit_piece(piece, palms, None if further is None else further(piece)))
    loss = {name: torch.cat([piece.loss[name] for piece in pieces]) for name in pieces[0].loss}
    return Fitted(HandPrediction.join([piece.prediction for piece in pieces]), loss)


def fit_minima(
    observation: Observation,
    objective: Objective,
    *,
    descent: Descent,
    further: Callable[[Observation], Start] | None = None,
    rounds: Sequence[Round] = ROUNDS,
) -> Minima:
    """Fit every hand from several starts, and keep all results that differ.

    Args:
        observation: The landmarks, of one hand or more.
        objective: The loss to minimize.
        descent: Settings of the optimizer.
        further: Function that makes more starts per hand.
        rounds: Selection of the starts.

    Raises:
        ValueError: The second-order solver cannot minimize this loss.
    """
    refuse_without_derivatives(objective)
    last = last_stage(objective.data_term, observation, descent)
    solver = SecondOrder.of(replace(objective, data_term=last), finger_table=descent.finger_table)
    size = max(1, descent.hands_at_once // max(descent.starts, 1))
    parts = []
    for first in range(0, len(observation), size):
        piece = observation[first : first + size]
        palms = _closed_form(piece, objective.hand, descent.starts) if descent.starts else None
        more = None if further is None else further(piece)
        parts.append(solver.minima(piece, palms, more, rounds))
    return Minima.join(parts)


def refuse_without_derivatives(objective: Objective) -> None:
    """Refuse a loss whose minima cannot be found.

    Args:
        objective: The loss.

    Raises:
        ValueError: The second-order solver cannot minimize it.
    """
    missing = _without_derivatives(objective)
    if missing:
        raise ValueError(
            "Several minima need the second-order solver, which has no derivatives of "
            f"{' and '.join(missing)}. Use prior=natural and hand=open, or fit every hand alone."
        )


def with_possible_solver(descent: Descent, objective: Objective) -> Descent:
    """Settings with a solver that can minimize a loss; a note says so if it is another one.

    Args:
        descent: Settings of the optimizer.
        objective: The loss; with a hand of one shape there is no note, since the model that it came from is
            fitted first.
    """
    missing = _without_derivatives(objective)
    if descent.solver != "second_order" or not missing:
        return descent
    if not objective.hand.one_shape:
        logger.info(
            "Fitting by Adam, which is slower: the second-order solver has no derivatives of %s.",
            " and ".join(missing),
        )
    return replace(descent, solver="adam")


def _without_derivatives(objective: Objective) -> list[str]:
    """Parts of a loss that the second-order solver cannot differentiate, in words."""
    missing = [f"the prior's {name}" for name in without_second_derivatives(objective.prior)]
    if objective.hand.pose_directions is not None:
        missing.append(f"the pose blend shapes of the hand {objective.hand.name!r}")
    return missing


def _closed_form(observation: Observation, hand: HandModel, count: int) -> Start:
    """Closed-form starts: batch × starts."""
    return closed_form_starts(
        hand,
        observation.landmarks_2d,
        observation.labelled,
        observation.intrinsics,
        count=count,
    )


def _solver(
    observation: Observation, objective: Objective, descent: Descent
) -> Callable[[Observation, Start | None, Start | None], Fitted]:
    """Function that fits a batch of hands from placements of the palm and further starts."""
    if descent.solver != "adam" and not _without_derivatives(objective):
        last = last_stage(objective.data_term, observation, descent)
        return SecondOrder.of(
            replace(objective, data_term=last),
            finger_table=descent.finger_table,
            correction=correction_named(descent.error_bars),
        )
    objectives = (objective.without_non_penetration(), objective)

    def by_adam(piece: Observation, palms: Start | None, further: Start | None) -> Fitted:
        starts = [start for start in (palms, further) if start is not None]
        return _fit_batch(piece, Start.beside(starts), objectives, descent)

    return by_adam


def last_stage(term: DataTerm, observation: Observation, descent: Descent) -> DataTerm:
    """Copy of a data term in the stage in which Adam would end."""
    term, steps = copy.deepcopy(term), max(descent.steps, 2)
    term.observe(observation.log_sigma().exp(), observation.labelled)
    term.begin(step=steps - 1, epoch=0, total_steps=steps)
    return term


def _fit_batch(
    observation: Observation,
    starts: Start,
    objectives: tuple[Objective, Objective],
    descent: Descent,
) -> Fitted:
    """Fit a batch: from every start without non-penetration, then from the best of each hand with it."""
    count = starts.translation.shape[1]
    several = observation[torch.arange(len(observation)).repeat_interleave(count)]
    unknowns = AdamUnknowns(starts.flat(), several.intrinsics)
    # A copy for every batch, so that each goes through the stages from the first.
    data_term = copy.deepcopy(objectives[0].data_term)
    light, whole = (replace(objective, data_term=data_term) for objective in objectives)
    first_steps = round(descent.non_penetration_from * descent.steps)
    _descend(unknowns, several, light, descent, range(first_steps))
    with torch.no_grad():
        reached = light(unknowns.parameters(several.intrinsics), several)
        total = reached.loss["total"].nan_to_num(torch.inf).unflatten(0, (-1, count))
    unknowns.keep(total.argmin(dim=1) + torch.arange(len(total)) * count)
    _descend(unknowns, observation, whole, descent, range(first_steps, descent.steps))
    with torch.no_grad():
        found = unknowns.parameters(observation.intrinsics)
        return whole(found, observation)


def _descend(
    unknowns: AdamUnknowns,
    observation: Observation,
    objective: Objective,
    descent: Descent,
    steps: range,
) -> None:
    """Take some of the steps of a descent; changes the unknowns."""
    optimizer = unknowns.optimizer()
    sigma = observation.log_sigma().exp()
    for step in steps:
        # A stage that begins with the size of the residuals gets the given σ in their stead.
        objective.data_term.observe(sigma, observation.labelled)
        objective.data_term.begin(step=step, epoch=0, total_steps=descent.steps)
        parameters = unknowns.parameters(observation.intrinsics)
        loss = objective(parameters, observation).loss["total"]
        # Hands share no parameter: the gradient of the sum is that of each hand's own loss.
        gradients = torch.autograd.grad(loss.sum(), optimizer.values)
        cosine = 0.5 * (1 + math.cos(math.pi * step / descent.steps))
        optimizer.step(gradients, descent.learning_rate * cosine)
