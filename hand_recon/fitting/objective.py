"""The loss of a fit and its result: the training's loss on hand parameters (Sec. 3.4)."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.camera import project
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.seen_pose import SeenPoseTerm
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.prior import Prior
from hand_recon.schema import HandParameters, HandPrediction
from hand_recon.uncertainty import DataTerm


@dataclass(frozen=True)
class Fitted:
    """The best result of each hand."""

    prediction: HandPrediction
    """The hands, in the form of a network's prediction; `log_sigma` is the observation's."""
    loss: dict[str, Float[Tensor, " hand"]]
    """Terms of the loss: raw under their names, weighted under `weighted/<name>`, the sum as `total`."""

    def put(self, hands: Tensor, some: "Fitted") -> "Fitted":
        """These results with those of some hands replaced.

        Args:
            hands: Indices of those hands.
            some: Their results, with the same terms of the loss.
        """
        loss = {
            name: value.index_put((hands,), some.loss[name]) for name, value in self.loss.items()
        }
        order = torch.arange(len(self.prediction.log_sigma), device=hands.device)
        order[hands] = len(order) + torch.arange(len(hands), device=hands.device)
        both = HandPrediction.join([self.prediction, some.prediction])
        return Fitted(both.select(order), loss)


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
    seen_pose_term: SeenPoseTerm | None = None
    """Term of the pose that a network sees; None without a network."""

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
        if self.seen_pose_term is not None:
            seen = self.seen_pose_term.value(parameters.joint_angles.flatten(1), observation)
            raw["seen_pose"] = seen
            weighted["seen_pose"] = self.seen_pose_term.weight * seen
        loss = {"total": data + sum(weighted.values()), "data": data, **raw}
        return Fitted(
            prediction, loss | {f"weighted/{name}": value for name, value in weighted.items()}
        )

    def without_non_penetration(self) -> "Objective":
        """The same without non-penetration, on the few vertices that landmarks need: several times faster."""
        return replace(self, hand=self.hand.landmarks_only(), with_non_penetration=False)
