"""Audited hands with a pose: given exactly, or fitted to 3D landmarks, all as right hands in metres."""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.plausibility.given_hands import GivenHands
from hand_recon.plausibility.point_fit import PointFit, PointFitter
from hand_recon.schema import HandParameters

FEWEST: Final = 12
"""Least number of landmarks of a hand that can be fitted."""

MIRROR: Final = (-1.0, 1.0, 1.0)


@dataclass(frozen=True)
class HandModels:
    """Hand models that audited hands can have."""

    fitted: HandModel
    """Model that is fitted to points, in their landmark set."""
    open: HandModel
    """The open hand."""
    _surfaces: dict[str, NonPenetration] = field(default_factory=dict)
    """Surfaces by name of the model, each made when it is first needed."""

    @classmethod
    def of(cls, hand: HandModel) -> "HandModels":
        """The configured hand, and the open hand for files of open hands.

        Args:
            hand: The configured hand.
        """
        return cls(hand, hand if hand.name == "open" else open_hand())

    def depths(
        self, name: str, vertices: Float[Tensor, "hand vertex 3"]
    ) -> Float[Tensor, "hand vertex"]:
        """Depth of each vertex inside another part of its hand, metres.

        Args:
            name: Name of a model that is there.
            vertices: Its posed surfaces, metres.
        """
        if name not in self._surfaces:
            hand = self.fitted if name == self.fitted.name else self.open
            self._surfaces[name] = NonPenetration(hand)
        return self._surfaces[name].depths(vertices)

    def named(self, name: str) -> HandModel | None:
        """The model of a name, `open` or `mano`; None for MANO without its files."""
        if name == self.fitted.name:
            return self.fitted
        return self.open if name == "open" else None


@dataclass(frozen=True)
class PosedHands:
    """Right hands, or mirrored left ones, with pose, shape and landmarks; NaN for hands without a pose."""

    given: GivenHands
    """The hands as their files give them, in metres."""
    left: Bool[Tensor, " hand"]
    """Mask of the left hands, which are mirrored."""
    points: Float[Tensor, "hand landmark=21 3"]
    """Given landmarks, mirrored for left hands, metres; NaN where there are none."""
    parameters: HandParameters
    """Pose and shape."""
    landmarks: Float[Tensor, "hand landmark=21 3"]
    """Landmarks of the posed hands, or the given ones of hands whose model is not there, metres."""
    exact: Bool[Tensor, " hand"]
    """Mask of the hands whose angles are given, not fitted."""
    models: tuple[str, ...]
    """Hand model of each hand's parameters."""

    def __len__(self) -> int:
        return len(self.left)

    @property
    def posed(self) -> Bool[Tensor, " hand"]:
        """Mask of the hands that have a pose."""
        return self.parameters.joint_angles.isfinite().flatten(1).all(dim=1)


def posed_hands(given: GivenHands, models: HandModels, side: str = "auto") -> PosedHands:
    """Pose every hand.

    Args:
        given: Hands, metres.
        models: Hand models.
        side: `left` or `right` for points that the source does not tell the side of, `auto` to see it.

    Raises:
        ValueError: The side is unknown.
    """
    if side not in ("auto", "left", "right"):
        raise ValueError(f"side={side} is unknown; expected auto, left or right.")
    names = tuple(name or models.fitted.name for name in given.hand_models)
    known = [side == "left" if one is None and side != "auto" else one for one in given.left]
    left = torch.tensor([bool(one) for one in known])
    mirror = torch.tensor(MIRROR)
    points = torch.where(left[:, None, None], given.points * mirror, given.points)
    exact = given.exact
    parameters, landmarks = _within_a_turn(given.parameters), points.clone()
    fittable = points.isfinite().all(dim=-1).sum(dim=1) >= FEWEST
    rows = (fittable & ~exact).nonzero()[:, 0]
    if len(rows):
        open_side = torch.tensor([one is None for one in known])[rows]
        fit, turned = _fitted(PointFitter(models.fitted), points[rows], open_side)
        left = left.index_put((rows,), left[rows] ^ turned)
        points[rows[turned]] *= mirror
        parameters = _put(parameters, rows, fit.parameters)
        landmarks[rows] = fit.landmarks
    for row in exact.nonzero()[:, 0].split(512):
        _pose_exactly(row, models, names, parameters, landmarks)
    return PosedHands(given, left, points, parameters, landmarks, exact, names)


def _within_a_turn(parameters: HandParameters) -> HandParameters:
    """The same poses with every angle within half a turn.

    A fit may count a joint's turns: a bend of 288° is one of −72°, and not 208° beyond 80°. Each rotation has
    two triples of angles, of which the smaller one is taken.
    """
    angles = parameters.joint_angles
    first = torch.where(angles.abs() > math.pi, _wrapped(angles), angles)
    # Half a turn of bend and of splay, and the other side of twist, are the same rotation.
    second = _wrapped(math.pi + angles * torch.tensor([1.0, 1.0, -1.0]))
    smaller = second.abs().sum(dim=-1, keepdim=True) < first.abs().sum(dim=-1, keepdim=True)
    return replace(parameters, joint_angles=torch.where(smaller, second, first))


def _wrapped(angles: Tensor) -> Tensor:
    return torch.remainder(angles + math.pi, 2 * math.pi) - math.pi


def _fitted(
    fitter: PointFitter, points: Float[Tensor, "hand landmark=21 3"], open_side: Tensor
) -> tuple[PointFit, Bool[Tensor, " hand"]]:
    """Fit hands, those of unknown side also as mirror images; the mask marks mirrored ones that fit better.

    A fitted right hand bends its fingers towards the palm. The mirror image of a hand would have to bend them
    backwards, and its thumb would be on the other side of the palm.
    """
    fit = fitter(points)
    turned = torch.zeros_like(open_side)
    rows = open_side.nonzero()[:, 0]
    if len(rows):
        other = fitter(points[rows] * torch.tensor(MIRROR))
        better = other.loss < fit.loss[rows]
        chosen = rows[better]
        turned[chosen] = True
        fit.landmarks[chosen], fit.loss[chosen] = other.landmarks[better], other.loss[better]
        fit = PointFit(
            _put(fit.parameters, chosen, other.parameters.select(better)), fit.landmarks, fit.loss
        )
    return fit, turned


def _put(parameters: HandParameters, rows: Tensor, some: HandParameters) -> HandParameters:
    """Parameters with those of some hands replaced."""
    return HandParameters(
        parameters.joint_angles.index_put((rows,), some.joint_angles),
        parameters.shape.index_put((rows,), some.shape),
        parameters.root_rotation.index_put((rows,), some.root_rotation),
        parameters.translation.index_put((rows,), some.translation),
    )


def _pose_exactly(
    rows: Tensor,
    models: HandModels,
    names: tuple[str, ...],
    parameters: HandParameters,
    out: Tensor,
) -> None:
    """Landmarks of hands whose angles are given, in place; as given where the model is not there."""
    for name in {names[row] for row in rows.tolist()}:
        hand = models.named(name)
        own = torch.tensor([row for row in rows.tolist() if names[row] == name])
        some = parameters.select(own)
        if hand is not None and bool(some.shape.isfinite().all()):
            out[own] = hand.landmarks_only().to_camera(some).landmarks
