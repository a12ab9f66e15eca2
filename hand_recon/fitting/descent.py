"""Descent from several starts to one hand per set of landmarks: the loss of training, no network (Sec. 3.4)."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.camera import project, six_d_to_rotation
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.start import Start, closed_form_starts
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.prior import Prior
from hand_recon.schema import HandParameters, HandPrediction
from hand_recon.uncertainty import DataTerm

NEAREST: Final = 0.05
"""Metres from the camera that no hand comes nearer than."""


@dataclass(frozen=True)
class Descent:
    """How to descend."""

    starts: int = 4
    """Starts per hand in closed form; the one with the smallest loss is kept."""
    steps: int = 300
    """Steps of Adam."""
    rate: float = 0.1
    """Largest step of a joint angle, radians; it falls to zero as a cosine."""
    contact_from: float = 0.6
    """Share of the steps after which the non-penetration term joins: before, poses mean little, and a finger
    must be free to pass through another."""
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

    def __init__(self, start: Start, observation: Observation) -> None:
        pixel = project(start.translation[:, None], observation.intrinsics)[:, 0]
        depth = start.translation[:, 2].clamp(min=NEAREST)
        self.intrinsics = observation.intrinsics
        self.joint_angles = start.joint_angles.clone().requires_grad_()
        self.shape = pixel.new_zeros(len(pixel), 10).requires_grad_()
        self.columns = start.root_rotation[..., :2].mT.flatten(-2).clone().requires_grad_()
        # Hundreds of pixels: a step of 0.05 is then five pixels.
        self.place = (pixel / 100).requires_grad_()
        self.log_depth = depth.log().requires_grad_()

    def groups(self, rate: float) -> list[dict[str, object]]:
        """The optimizer's parameter groups."""
        fast = [self.joint_angles, self.columns]
        return [
            {"params": fast, "lr": rate, "share": 1.0},
            {"params": [self.shape], "lr": rate, "share": 1.0},
            {"params": [self.place, self.log_depth], "lr": rate, "share": 0.6},
        ]

    def parameters(self) -> HandParameters:
        """The hand that they mean."""
        pixel = torch.cat([self.place * 100, torch.ones_like(self.log_depth)[:, None]], dim=-1)
        rays = torch.linalg.solve(self.intrinsics, pixel[..., None])[..., 0]
        return HandParameters(
            self.joint_angles,
            self.shape,
            six_d_to_rotation(self.columns),
            rays * self.log_depth.exp().clamp(min=NEAREST)[:, None],
        )


def fit(
    observation: Observation,
    hand: HandModel,
    prior: Prior,
    data_term: DataTerm,
    *,
    descent: Descent,
    further: Callable[[Observation], Start] | None = None,
    advance: Callable[[int], None] = lambda hands: None,
) -> Fitted:
    """Fit every hand to its landmarks.

    Args:
        observation: The landmarks.
        hand: The hand model.
        prior: Knowledge (Eq. 5).
        data_term: Residuals → one value per hand; a staged one goes through its stages.
        descent: How.
        further: Makes more starts per hand, such as a lifter's answer.
        advance: Told how many hands are done, for a progress bar.
    """
    size = max(1, descent.hands_at_once // max(descent.starts, 1))
    pieces = []
    for first in range(0, len(observation), size):
        piece = observation[first : first + size]
        starts = _starts(piece, hand, descent, further)
        pieces.append(_fit_batch(piece, starts, hand, prior, data_term, descent))
        advance(len(piece))
    return _joined(pieces)


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
    )


def _fit_batch(  # noqa: PLR0917  # what the whole fit is made of
    observation: Observation,
    starts: Start,
    hand: HandModel,
    prior: Prior,
    data_term: DataTerm,
    descent: Descent,
) -> Fitted:
    count = starts.translation.shape[1]
    several = observation[torch.arange(len(observation)).repeat_interleave(count)]
    unknowns = _Unknowns(
        Start(
            starts.joint_angles.flatten(0, 1),
            starts.root_rotation.flatten(0, 1),
            starts.translation.flatten(0, 1),
        ),
        several,
    )
    # Its own stages for every batch, as if each were a run.
    data_term = copy.deepcopy(data_term)
    light = hand.of_landmarks()
    told = several.log_sigma().exp()
    optimizer = torch.optim.Adam(unknowns.groups(descent.rate), betas=(0.9, 0.99))
    for step in range(descent.steps):
        # A stage that starts from the residuals' size starts from what the landmarks are trusted to.
        data_term.observe(told, several.labelled)
        data_term.begin(step=step, epoch=0, total_steps=descent.steps)
        contact = step >= descent.contact_from * descent.steps
        posed = hand if contact else light
        terms = _terms(unknowns, several, posed, prior, data_term, contact=contact)
        optimizer.zero_grad(set_to_none=True)
        # Hands do not share anything: the gradient of the sum is each hand's own.
        terms.total.sum().backward()
        _set_rate(optimizer, descent, step)
        optimizer.step()
    with torch.no_grad():
        terms = _terms(unknowns, several, hand, prior, data_term, contact=True)
        total = terms.total.nan_to_num(torch.inf).unflatten(0, (-1, count))
        best = total.argmin(dim=1) + torch.arange(len(total)) * count
        return Fitted(
            terms.prediction.select(best),
            {name: value[best] for name, value in terms.loss.items()},
        )


@dataclass(frozen=True)
class _Terms:
    prediction: HandPrediction
    loss: dict[str, Tensor]

    @property
    def total(self) -> Float[Tensor, " hand"]:
        return self.loss["total"]


def _terms(
    unknowns: _Unknowns,
    observation: Observation,
    hand: HandModel,
    prior: Prior,
    data_term: DataTerm,
    *,
    contact: bool,
) -> _Terms:
    parameters = unknowns.parameters()
    posed = hand.place(parameters)
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
    data = data_term(residual, prediction.log_sigma, observation.labelled)
    raw = prior(prediction, contact=contact)
    weighted = prior.weighted(raw)
    loss = {"total": data + sum(weighted.values()), "data": data, **raw}
    loss |= {f"weighted/{name}": value for name, value in weighted.items()}
    return _Terms(prediction, loss)


def _set_rate(optimizer: torch.optim.Optimizer, descent: Descent, step: int) -> None:
    fall = 0.5 * (1 + torch.cos(torch.tensor(torch.pi * step / descent.steps)).item())
    for group in optimizer.param_groups:
        group["lr"] = descent.rate * group["share"] * fall


def _joined(pieces: list[Fitted]) -> Fitted:
    loss = {name: torch.cat([piece.loss[name] for piece in pieces]) for name in pieces[0].loss}
    return Fitted(HandPrediction.join([piece.prediction for piece in pieces]), loss)
