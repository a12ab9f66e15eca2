"""Levenberg–Marquardt for many small problems at once, each with its own damping and its own end.

A step solves (H + damping · diag H) step = −gradient. The hinge of the ranges has two branches, flat inside
and curved outside, and a step computed with the branches of the current angles often ends far outside a
range. Such a step is solved again, with the branches of the angles that the first solution expects.
"""

from dataclasses import dataclass
from typing import Final, Protocol, Self, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.fitting.second_order.least_squares import Model
from hand_recon.fitting.second_order.unknowns import ANGLES, COUNT, ROTATION, Unknowns

FIRST_DAMPING: Final = 1e-2
LEAST_DAMPING: Final = 1e-6
GREATEST_DAMPING: Final = 1e6
DECREASE: Final = 0.2
"""Factor of the damping after a step that lowered the loss."""
INCREASE: Final = 5.0
"""Factor of the damping after a step that did not, and is taken back."""
DAMPED_SHARE: Final = 1e-4
"""Damping of unknowns without curvature, as a share of the largest curvature of the hand."""


@runtime_checkable
class Loss(Protocol):
    """A loss of some hands with its second-order model."""

    def __call__(self, unknowns: Unknowns) -> Model:
        """The loss and its derivatives at some hands."""

    def __getitem__(self, hands: Tensor) -> Self:
        """The loss of some of the hands."""


@dataclass(frozen=True)
class Reached:
    """Hands after a number of steps."""

    unknowns: Unknowns
    """The hands."""
    model: Model
    """Their loss with its derivatives."""
    damping: Float[Tensor, " hand"]
    """The damping that a next step will have."""

    @classmethod
    def at(
        cls, problem: Loss, unknowns: Unknowns, damping: Float[Tensor, " hand"] | None = None
    ) -> Self:
        """Hands before the first step.

        Args:
            problem: The loss.
            unknowns: The hands.
            damping: First damping of each hand, `FIRST_DAMPING` if none is given.
        """
        model = problem(unknowns)
        if damping is None:
            damping = torch.full_like(model.value, FIRST_DAMPING)
        return cls(unknowns, model, damping)

    def __getitem__(self, hands: Tensor) -> Self:
        """The results of some of the hands."""
        return type(self)(self.unknowns[hands], self.model[hands], self.damping[hands])

    def joined(self, other: Self) -> Self:
        """These results, then other ones.

        Args:
            other: Results of the same kind of problem.
        """
        return type(self)(
            self.unknowns.joined(other.unknowns),
            self.model.joined(other.model),
            torch.cat([self.damping, other.damping]),
        )

    def put(self, hands: Tensor, some: Self) -> Self:
        """These results with those of some hands replaced.

        Args:
            hands: Indices of those hands.
            some: Their results.
        """
        return type(self)(
            self.unknowns.put(hands, some.unknowns),
            self.model.put(hands, some.model),
            self.damping.index_put((hands,), some.damping),
        )


@dataclass(frozen=True)
class Limits:
    """Number and size of the steps."""

    iterations: int
    """Most steps."""
    tolerance: float = 1e-4
    """A hand whose loss falls by less than this share of itself has converged."""
    largest_angle: float = 0.5
    """Largest change of an angle in one step, radians."""


def damped_step(model: Model, damping: Float[Tensor, " hand"]) -> Float[Tensor, "hand unknown=61"]:
    """Solve for the step of each hand.

    Args:
        model: The loss at the current hands.
        damping: Damping of each hand.
    """
    diagonal = model.curvature.diagonal(dim1=1, dim2=2)
    # A little even without damping, so that the matrix stays positive definite in single precision.
    least = DAMPED_SHARE * diagonal.amax(dim=1, keepdim=True)
    added = damping[:, None] * (diagonal + least) + 1e-3 * least
    hinge = model.hinge
    if hinge is None:
        step = _solved(model, added)
    else:
        branches = hinge.expanded(hinge.angles)
        step = _solved(model, added, branches)
        expected = hinge.expanded(hinge.angles + step[:, : hinge.angles.shape[1]])
        # Most steps cross no bound.
        changed = (expected[0] != branches[0]).any(dim=1).nonzero()[:, 0]
        if len(changed):
            other = (expected[0][changed], expected[1][changed])
            step[changed] = _solved(model[changed], added[changed], other)
    return step.new_zeros(len(step), COUNT).index_copy(1, model.free, step)


def _solved(
    model: Model, added: Tensor, branches: tuple[Tensor, Tensor] | None = None
) -> Float[Tensor, "hand unknown"]:
    """Solve the linear equations of a step.

    Args:
        model: The loss at the current hands.
        added: What is added to the diagonal of the curvature.
        branches: Gradient and curvature of the hinge.
    """
    matrix, gradient = model.curvature.clone(), model.gradient
    if branches is not None:
        gradient, added = gradient.clone(), added.clone()
        count = branches[0].shape[1]
        gradient[:, :count] += branches[0]
        added[:, :count] += branches[1]
    matrix.diagonal(dim1=1, dim2=2).add_(added)
    factor, _ = torch.linalg.cholesky_ex(matrix)
    return -torch.cholesky_solve(gradient[..., None], factor)[..., 0]


def minimize(problem: Loss, start: Reached, limits: Limits) -> Reached:
    """Take steps until every hand has converged or the steps are used up.

    A step that does not lower a hand's loss is taken back, so the loss never rises. Converged hands are left
    out of the further steps once they are a quarter of all.

    Args:
        problem: The loss.
        start: The hands to start from.
        limits: Number and size of the steps.
    """
    everything = here = start
    rows = torch.arange(len(start.damping), device=start.damping.device)
    for _ in range(limits.iterations if len(rows) else 0):
        here, done = _stepped(problem, here, limits)
        if done.all():
            break
        if 4 * int(done.sum()) > len(done):
            everything = everything.put(rows, here)
            going = (~done).nonzero()[:, 0]
            rows, here, problem = rows[going], here[going], problem[going]
    return here if len(rows) == len(start.damping) else everything.put(rows, here)


def _stepped(problem: Loss, here: Reached, limits: Limits) -> tuple[Reached, Bool[Tensor, " hand"]]:
    """Take one step; the mask is true for hands that have converged."""
    step = _limited(damped_step(here.model, here.damping), limits.largest_angle)
    trial = here.unknowns.moved(step)
    model, before = problem(trial), here.model.value
    # False for NaN as well.
    better = model.value < before
    done = better & (before - model.value < limits.tolerance * before.abs())
    done |= here.damping >= GREATEST_DAMPING
    factor = torch.where(better, DECREASE, INCREASE)
    damping = (here.damping * factor).clamp(LEAST_DAMPING, GREATEST_DAMPING)
    unknowns = trial.where(better, here.unknowns)
    return Reached(unknowns, model.where(better, here.model), damping), done


def _limited(step: Float[Tensor, "hand unknown=61"], largest: float) -> Tensor:
    """Shorten steps whose largest change of an angle is too large."""
    turned = step[:, ANGLES.start : ROTATION.stop].abs().amax(dim=1, keepdim=True)
    return step * (largest / turned.clamp(min=largest))
