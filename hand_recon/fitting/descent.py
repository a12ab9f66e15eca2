"""Fit of hands to 2D landmarks: Adam from several starts on the training's loss, no network (Sec. 3.4)."""

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.camera import project, six_d_to_rotation
from hand_recon.fitting.adam import Adam
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.start import SHALLOWEST, Start, closed_form_starts
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.prior import Prior
from hand_recon.schema import HandParameters, HandPrediction
from hand_recon.uncertainty import DataTerm


@dataclass(frozen=True)
class Descent:
    """Settings of the optimizer."""

    starts: int = 4
    """Closed-form starts per hand."""
    steps: int = 300
    """Steps of Adam."""
    learning_rate: float = 0.1
    """Adam's learning rate at the first step, radians for joint angles; it falls to zero as a cosine."""
    non_penetration_from: float = 0.6
    """Share of the steps without the non-penetration term. After them the start of smallest loss is kept.

    Before, poses are far from final, and a finger must be able to pass through another."""
    hands_at_once: int = 256
    """Hands times starts in one batch; batches that fit the processor's cache are fastest."""


@dataclass(frozen=True)
class Fitted:
    """The best result of each hand."""

    prediction: HandPrediction
    """The hands, in the form of a network's prediction; `log_sigma` is the observation's."""
    loss: dict[str, Float[Tensor, " hand"]]
    """Terms of the loss: raw under their names, weighted under `weighted/<name>`, the sum as `total`."""


class _Unknowns:
    """The optimized numbers of each hand, scaled so that one learning rate suits all of them."""

    def __init__(self, start: Start, intrinsics: Float[Tensor, "hand 3 3"]) -> None:
        pixel = project(start.translation[:, None], intrinsics)[:, 0]
        depth = start.translation[:, 2].clamp(min=SHALLOWEST)
        self.values = {
            "joint_angles": start.joint_angles,
            "columns": start.root_rotation[..., :2].mT.flatten(-2),
            "shape": start.shape,
            # The projected origin in hundreds of pixels: a step of 0.05 is five pixels.
            "origin": pixel / 100,
            "log_depth": depth.log(),
        }
        self._require_gradients()

    def _require_gradients(self) -> None:
        self.values = {
            name: value.detach().clone().requires_grad_() for name, value in self.values.items()
        }

    def keep(self, rows: Tensor) -> None:
        """Keep the rows with these indices, and drop the others."""
        self.values = {name: value[rows] for name, value in self.values.items()}
        self._require_gradients()

    def optimizer(self) -> Adam:
        """Adam over all numbers; the translation has 0.6 of the learning rate."""
        shares = [0.6 if name in ("origin", "log_depth") else 1.0 for name in self.values]
        return Adam(list(self.values.values()), shares, betas=(0.9, 0.99))

    def parameters(self, intrinsics: Float[Tensor, "hand 3 3"]) -> HandParameters:
        """The parameters of the hands, for cameras with these matrices."""
        values = self.values
        one = torch.ones_like(values["log_depth"])[:, None]
        pixel = torch.cat([values["origin"] * 100, one], dim=-1)
        rays = torch.linalg.solve(intrinsics, pixel[..., None])[..., 0]
        return HandParameters(
            values["joint_angles"],
            values["shape"],
            six_d_to_rotation(values["columns"]),
            rays * values["log_depth"].exp().clamp(min=SHALLOWEST)[:, None],
        )


@dataclass(frozen=True)
class Objective:
    """The training's loss as a function of hand parameters (Sec. 3.4)."""

    hand: HandModel
    """The hand model."""
    prior: Prior
    """Prior of hand knowledge (Eq. 5)."""
    data_term: DataTerm
    """Term of the 2D residuals, one value per hand; a staged term goes through its stages."""
    with_non_penetration: bool = True
    """True if the hand model has all its vertices, which the non-penetration term needs."""

    def __call__(self, parameters: HandParameters, observation: Observation) -> Fitted:
        """Pose hands and compute every term of their loss.

        Args:
            parameters: Parameters of each hand.
            observation: The landmarks of the same hands.
        """
        posed = self.hand.to_camera(parameters)
        prediction = HandPrediction(
            parameters=parameters,
            vertices=posed.vertices,
            joints=posed.joints,
            landmarks_3d=posed.landmarks,
            landmarks_2d=project(posed.landmarks, observation.intrinsics),
            log_sigma=observation.log_sigma(),
            intrinsics=observation.intrinsics,
        )
        residual = prediction.landmarks_2d - observation.landmarks_2d
        data = self.data_term(residual, prediction.log_sigma, observation.labelled)
        raw = self.prior(parameters, posed.vertices if self.with_non_penetration else None)
        weighted = self.prior.weighted(raw)
        loss = {"total": data + sum(weighted.values()), "data": data, **raw}
        return Fitted(
            prediction, loss | {f"weighted/{name}": value for name, value in weighted.items()}
        )

    def without_non_penetration(self) -> "Objective":
        """The same without non-penetration, on the few vertices that landmarks need: several times faster."""
        return replace(self, hand=self.hand.landmarks_only(), with_non_penetration=False)


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
    light = objective.without_non_penetration()
    pieces = []
    # One batch even without a hand, such as for a part of a video in which none was detected.
    for first in range(0, max(len(observation), 1), size):
        piece = observation[first : first + size]
        starts = _starts(piece, objective.hand, descent, further)
        pieces.append(_fit_batch(piece, starts, (light, objective), descent))
    loss = {name: torch.cat([piece.loss[name] for piece in pieces]) for name in pieces[0].loss}
    return Fitted(HandPrediction.join([piece.prediction for piece in pieces]), loss)


def _starts(
    observation: Observation,
    hand: HandModel,
    descent: Descent,
    further: Callable[[Observation], Start] | None,
) -> Start:
    """All starts of all hands: batch × starts."""
    found = []
    if descent.starts:
        found.append(
            closed_form_starts(
                hand,
                observation.landmarks_2d,
                observation.labelled,
                observation.intrinsics,
                count=descent.starts,
            )
        )
    if further is not None:
        found.append(further(observation))
    return Start(
        torch.cat([start.joint_angles for start in found], dim=1),
        torch.cat([start.root_rotation for start in found], dim=1),
        torch.cat([start.translation for start in found], dim=1),
        torch.cat([start.shape for start in found], dim=1),
    )


def _fit_batch(
    observation: Observation,
    starts: Start,
    objectives: tuple[Objective, Objective],
    descent: Descent,
) -> Fitted:
    """Fit a batch: from every start without non-penetration, then from the best of each hand with it."""
    count = starts.translation.shape[1]
    several = observation[torch.arange(len(observation)).repeat_interleave(count)]
    unknowns = _Unknowns(
        Start(
            starts.joint_angles.flatten(0, 1),
            starts.root_rotation.flatten(0, 1),
            starts.translation.flatten(0, 1),
            starts.shape.flatten(0, 1),
        ),
        several.intrinsics,
    )
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
    unknowns: _Unknowns,
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
