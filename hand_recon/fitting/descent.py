"""Descent from several starts to one hand per set of landmarks: training's loss, no network (Sec. 3.4)."""

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.camera import project, six_d_to_rotation
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.start import SHALLOWEST, Start, closed_form_starts
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.prior import Prior
from hand_recon.schema import HandParameters, HandPrediction
from hand_recon.uncertainty import DataTerm


@dataclass(frozen=True)
class Descent:
    """How to descend."""

    starts: int = 4
    """Starts per hand in closed form."""
    steps: int = 300
    """Steps of Adam."""
    rate: float = 0.1
    """Largest step of a joint angle, radians; it falls to zero as a cosine."""
    contact_from: float = 0.6
    """Share of the steps after which the start with the smallest loss goes on alone, and the non-penetration
    term joins: before, poses mean little, and a finger must be free to pass through another."""
    hands_at_once: int = 256
    """Hands (times starts) in one batch: what fits a processor's cache is fastest."""


@dataclass(frozen=True)
class Fitted:
    """The best descent of each hand."""

    prediction: HandPrediction
    """As a network's would be; `log_sigma` is what the fit was told."""
    loss: dict[str, Float[Tensor, " hand"]]
    """Every term: raw under its name, weighted under `weighted/`, and their sum, `total`."""


class _Unknowns:
    """What is descended on: every number of a hand, on a scale on which steps are alike."""

    def __init__(self, start: Start, intrinsics: Float[Tensor, "hand 3 3"]) -> None:
        pixel = project(start.translation[:, None], intrinsics)[:, 0]
        depth = start.translation[:, 2].clamp(min=SHALLOWEST)
        self.values = {
            "joint_angles": start.joint_angles,
            "columns": start.root_rotation[..., :2].mT.flatten(-2),
            "shape": start.shape,
            # Hundreds of pixels: a step of 0.05 is then five pixels.
            "place": pixel / 100,
            "log_depth": depth.log(),
        }
        self._require_gradients()

    def _require_gradients(self) -> None:
        self.values = {
            name: value.detach().clone().requires_grad_() for name, value in self.values.items()
        }

    def keep(self, which: Tensor) -> None:
        """Go on with some of the hands."""
        self.values = {name: value[which] for name, value in self.values.items()}
        self._require_gradients()

    def optimizer(self, rate: float) -> torch.optim.Optimizer:
        """Adam over all of them; angles and shapes move at the full rate, places at most of it."""
        place = {"place", "log_depth"}
        fast = [value for name, value in self.values.items() if name not in place]
        slow = [value for name, value in self.values.items() if name in place]
        groups = [
            {"params": fast, "lr": rate, "share": 1.0},
            {"params": slow, "lr": rate, "share": 0.6},
        ]
        return torch.optim.Adam(groups, betas=(0.9, 0.99))

    def parameters(self, intrinsics: Float[Tensor, "hand 3 3"]) -> HandParameters:
        """The hands that they mean, before cameras with these matrices."""
        values = self.values
        one = torch.ones_like(values["log_depth"])[:, None]
        pixel = torch.cat([values["place"] * 100, one], dim=-1)
        rays = torch.linalg.solve(intrinsics, pixel[..., None])[..., 0]
        return HandParameters(
            values["joint_angles"],
            values["shape"],
            six_d_to_rotation(values["columns"]),
            rays * values["log_depth"].exp().clamp(min=SHALLOWEST)[:, None],
        )


@dataclass(frozen=True)
class Objective:
    """The loss of training over the hands themselves (Sec. 3.4)."""

    hand: HandModel
    """The hand model."""
    prior: Prior
    """Knowledge (Eq. 5)."""
    data_term: DataTerm
    """Residuals → one value per hand; a staged one goes through its stages."""
    surface: bool = True
    """Whether the hand has its surface, so that contact counts."""

    def __call__(self, parameters: HandParameters, observation: Observation) -> Fitted:
        """The hands with every term of their loss.

        Args:
            parameters: Of each hand.
            observation: What they should look like.
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
        raw = self.prior(parameters, posed.vertices if self.surface else None)
        weighted = self.prior.weighted(raw)
        loss = {"total": data + sum(weighted.values()), "data": data, **raw}
        return Fitted(
            prediction, loss | {f"weighted/{name}": value for name, value in weighted.items()}
        )

    def without_surface(self) -> "Objective":
        """The same on the few vertices that landmarks need, several times faster."""
        return replace(self, hand=self.hand.landmarks_only(), surface=False)


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
        objective: What is made small.
        descent: How.
        further: Makes more starts per hand, such as a lifter's answer.

    Raises:
        ValueError: There is nothing to start from.
    """
    if not descent.starts and further is None:
        raise ValueError(
            "A fit needs a start: found descent.starts=0 and no lifter. Give 1 to 4 starts, or a lifter."
        )
    size = max(1, descent.hands_at_once // max(descent.starts, 1))
    light = objective.without_surface()
    pieces = []
    # No hand at all is a batch too: a stretch of a video in which none was found.
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
    """Every start of every hand: batch × starts."""
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
    """The best descent of each hand: without the surface from every start, then with it from the best."""
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
    # Its own stages for every batch, as if each were a run.
    data_term = copy.deepcopy(objectives[0].data_term)
    light, whole = (replace(objective, data_term=data_term) for objective in objectives)
    alone = round(descent.contact_from * descent.steps)
    _descend(unknowns, several, light, descent, range(alone))
    with torch.no_grad():
        reached = light(unknowns.parameters(several.intrinsics), several)
        total = reached.loss["total"].nan_to_num(torch.inf).unflatten(0, (-1, count))
    unknowns.keep(total.argmin(dim=1) + torch.arange(len(total)) * count)
    _descend(unknowns, observation, whole, descent, range(alone, descent.steps))
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
    """Some of the steps of a descent, in place."""
    optimizer = unknowns.optimizer(descent.rate)
    told = observation.log_sigma().exp()
    for step in steps:
        # A stage that starts from the residuals' size starts from what the landmarks are trusted to.
        objective.data_term.observe(told, observation.labelled)
        objective.data_term.begin(step=step, epoch=0, total_steps=descent.steps)
        parameters = unknowns.parameters(observation.intrinsics)
        loss = objective(parameters, observation).loss["total"]
        optimizer.zero_grad(set_to_none=True)
        # Hands do not share anything: the gradient of the sum is each hand's own.
        loss.sum().backward()
        fall = 0.5 * (1 + math.cos(math.pi * step / descent.steps))
        for group in optimizer.param_groups:
            group["lr"] = descent.rate * group["share"] * fall
        optimizer.step()
