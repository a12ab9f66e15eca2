"""One shape for all hands of one person, estimated from all of them (Sec. 3.4).

Each hand that is fitted alone gives a quadratic model of its loss as a function of the shape, with its pose
and place eliminated (the Schur complement, as in bundle adjustment). The shape minimizes the sum of these
models and the prior on shape, which counts once. Then poses are fitted again with this shape, and the models
are renewed. Hands that contradict the others, such as those with a wrong pose, get small weights; residuals
larger than the data term expects make all of them say less; and many hands say no more than `MOST_HANDS`,
because what the hand model cannot represent is the same in all of them (decision 69).
"""

from dataclasses import dataclass, replace
from typing import Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.objective import Fitted, Objective
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.second_order.data_weights import data_weights
from hand_recon.fitting.second_order.laplace import curvature_of, damped
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.levenberg_marquardt import Limits, Reached, minimize
from hand_recon.fitting.second_order.prior_terms import PriorTerms
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import SHAPE, Unknowns
from hand_recon.fitting.start import Start
from hand_recon.knowledge.prior import Prior
from hand_recon.schema import HandParameters

ROUNDS: Final = 5
"""Estimates of the shape, with poses fitted again between them."""

STEPS: Final = Limits(iterations=8, tolerance=1e-4)
"""Steps of the poses between two estimates."""

MOST_HANDS: Final = 32
"""Number of hands whose information is not exceeded, however many there are."""

FREEDOM: Final = 4.0
"""Degrees of freedom of the t distribution by which hands that contradict the others are weighted."""

REWEIGHTINGS: Final = 30
"""Steps of iteratively reweighted least squares for the shape."""

NEGLIGIBLE: Final = 1e-4
"""Share of a hand's largest curvature below which a direction of shape is not compared."""

_POSE: Final = slice(0, -10)
_SHAPE: Final = slice(-10, None)


@dataclass(frozen=True)
class ShapeModel:
    """Loss of each hand as a quadratic function of shape, with pose and place at their best."""

    at: Float[Tensor, "hand direction=10"]
    """Shape of each hand about which the loss is expanded, standard deviations."""
    gradient: Float[Tensor, "hand direction=10"]
    """Derivatives without the prior on shape."""
    curvature: Float[Tensor, "hand direction=10 direction=10"]
    """Second derivatives without the prior on shape: the information that a hand has on the shape."""

    @classmethod
    def of(cls, problem: Problem, unknowns: Unknowns) -> Self:
        """Eliminate pose and place from the loss at some hands.

        Missing landmarks, or a prior without terms, can leave pose without curvature in some directions.
        All of them are `damped`, so that such a direction explains nothing of the shape.

        Args:
            problem: The loss.
            unknowns: The hands.
        """
        model, prior = problem(unknowns), problem.terms.smooth(unknowns)
        free = model.free
        gradient, matrix = model.gradient.double(), curvature_of(model).double()
        smooth = torch.diag_embed(prior.diagonal[:, free]).double()
        if prior.matrix is not None:
            smooth = smooth + prior.matrix[free][:, free]
        of_data = model.curvature.double() - smooth
        seen = problem.seen(unknowns)
        if seen is not None:
            of_data = of_data - seen.curvature.double()
        if model.hinge is not None:
            slope, _ = model.hinge.expanded(model.hinge.angles)
            gradient[:, : slope.shape[1]] += slope
        gradient[:, _SHAPE] -= prior.gradient[:, SHAPE]
        matrix[:, _SHAPE, _SHAPE] = of_data[:, _SHAPE, _SHAPE]
        across, pose = matrix[:, _POSE, _SHAPE], matrix[:, _POSE, _POSE]
        right = torch.cat([gradient[:, _POSE, None], across, of_data[:, _POSE, _POSE]], dim=2)
        solved = torch.linalg.solve(damped(pose), right)
        used = solved[:, :, 11:].diagonal(dim1=1, dim2=2).sum(dim=1)
        share = 1 / _dispersion(problem, unknowns, used)
        eliminated = across.mT @ solved[:, :, :11]
        reduced = matrix[:, _SHAPE, _SHAPE] - eliminated[..., 1:]
        # The loss is in single precision, in which differences of large numbers can become negative.
        values, vectors = torch.linalg.eigh((reduced + reduced.mT) / 2)
        reduced = vectors * values.clamp(min=0)[:, None] @ vectors.mT
        gradient = gradient[:, _SHAPE] - eliminated[..., 0]
        return cls(unknowns.shape.double(), share * gradient, share * reduced)

    def gradient_at(
        self, shape: Float[Tensor, " direction=10"]
    ) -> Float[Tensor, "hand direction=10"]:
        """Derivatives of each hand's loss at a shape.

        Args:
            shape: Coefficients, standard deviations.
        """
        return self.gradient + (self.curvature @ (shape - self.at)[..., None])[..., 0]

    def excess(self, shape: Float[Tensor, " direction=10"]) -> Float[Tensor, " hand"]:
        """Twice the loss of each hand at a shape above its least, a squared Mahalanobis distance.

        Directions of shape that a hand says next to nothing about are left out.

        Args:
            shape: Coefficients, standard deviations.
        """
        slope = self.gradient_at(shape)
        inverse = torch.linalg.pinv(self.curvature, rtol=NEGLIGIBLE, hermitian=True)
        return (slope * (inverse @ slope[..., None])[..., 0]).sum(dim=1)


def _dispersion(
    problem: Problem, unknowns: Unknowns, used: Float[Tensor, " hand"]
) -> Float[Tensor, ""]:
    """Median ratio of squared residuals to those that the data term expects, at least one.

    Args:
        problem: The loss.
        unknowns: The hands.
        used: Number of parameters that each hand's landmarks determine.
    """
    at = problem.projection(unknowns, problem.observation.intrinsics, problem.inverse)
    residual = at.pixels.permute(2, 1, 0) - problem.target
    labelled = problem.observation.labelled
    weights = data_weights(problem.data_term, residual, problem.log_sigma, labelled)
    squares = (weights * residual.square()).sum(dim=(1, 2)).double()
    left = (2 * labelled.sum(dim=1) - used).clamp(min=1.0)
    return (squares / left).median().clamp(min=1.0)


def combined_shape(model: ShapeModel, terms: PriorTerms) -> Float[Tensor, " direction=10"]:
    """Shape of least loss over all hands and the priors on shape.

    Besides the prior of the fit, shape has a normal distribution: its coefficients are in standard
    deviations.

    Args:
        model: Losses of the hands.
        terms: Terms of the prior.
    """
    hands = len(model.at)
    # Contiguous, because PyTorch's median over the rows of an expanded tensor reads other memory (2.15).
    shape = model.at.contiguous().median(dim=0).values
    for _ in range(REWEIGHTINGS):
        # Maximum likelihood of a t distribution, in the ten coefficients.
        weight = ((FREEDOM + 10) / (FREEDOM + model.excess(shape))).clamp(max=1.0)
        weight = weight * min(1.0, MOST_HANDS / hands)
        prior = terms.smooth(_hand_of_shape(shape))
        matrix = (weight[:, None, None] * model.curvature).sum(dim=0)
        matrix = matrix + torch.diag(1.0 + prior.diagonal[0, SHAPE])
        if prior.matrix is not None:
            matrix = matrix + prior.matrix[SHAPE, SHAPE]
        slope = (weight[:, None] * model.gradient_at(shape)).sum(dim=0)
        slope = slope + shape + prior.gradient[0, SHAPE]
        shape = shape - torch.linalg.solve(matrix, slope)
    return shape


def _hand_of_shape(shape: Tensor) -> Unknowns:
    """One hand of a shape; nothing else in it matters."""
    return Unknowns(
        shape.new_zeros(1, 15, 3),
        torch.eye(3, dtype=shape.dtype)[None],
        shape.new_zeros(1, 3),
        shape[None],
    )


@torch.no_grad()
def shared_shape(
    observation: Observation, parameters: HandParameters, objective: Objective
) -> Float[Tensor, " direction=10"]:
    """Estimate the one shape of hands of one person.

    Args:
        observation: The landmarks of one hand or more.
        parameters: The hands, each fitted alone.
        objective: The loss, with its data term in the last stage.

    Returns:
        Coefficients, standard deviations.
    """
    unknowns = Unknowns.of_start(Start.of(parameters), observation.intrinsics)
    hand = objective.hand
    terms = PriorTerms(objective.prior, centred=True)
    free = terms.free()
    problem = Problem.of(
        LandmarkProjection(hand, free),
        terms,
        objective.data_term,
        observation,
        objective.seen_pose_term,
    )
    shape = unknowns.shape.new_zeros(10)
    for number in range(ROUNDS):
        if number:
            person = replace(problem, projection=LandmarkProjection(hand.of_shape(shape), free))
            unknowns = replace(unknowns, shape=torch.zeros_like(unknowns.shape))
            unknowns = minimize(person, Reached.at(person, unknowns), STEPS).unknowns
            unknowns = replace(unknowns, shape=shape.expand_as(unknowns.shape).contiguous())
        shape = combined_shape(ShapeModel.of(problem, unknowns), terms).to(unknowns.shape)
    return shape


def with_shape(fitted: Fitted, shape: Float[Tensor, " direction=10"], prior: Prior) -> Fitted:
    """Fits of a hand of one shape as fits of the hand model that it came from.

    Args:
        fitted: Fits of `HandModel.of_shape(shape)`.
        shape: Coefficients, standard deviations.
        prior: Prior of the fits; its values become those of this shape.
    """
    parameters = fitted.prediction.parameters
    whole = replace(parameters, shape=shape.to(parameters.shape).expand_as(parameters.shape))
    # Terms that need the surface do not depend on the coefficients.
    with torch.no_grad():
        raw = prior(whole)
    weighted = {f"weighted/{name}": value for name, value in prior.weighted(raw).items()}
    more = sum((value - fitted.loss[name] for name, value in weighted.items()), torch.zeros(()))
    loss = fitted.loss | raw | weighted | {"total": fitted.loss["total"] + more}
    return replace(fitted, prediction=replace(fitted.prediction, parameters=whole), loss=loss)
