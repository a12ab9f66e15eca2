"""Adversarial prior learnt from 3D data: real hands against predicted ones (Sec. 5, Table 3 (a)).

It is here to compare generic knowledge with. As in HMR (Kanazawa et al., CVPR 2018), which the paper follows
there, the discriminator has several small outputs: one for each joint's rotation, one for all joints together
and one for the shape. They are trained by least squares (Mao et al., ICCV 2017): 1 for real, 0 for predicted.

The discriminator's weights require a gradient only in its own step. The generator loss therefore flows
through them into pose and shape alone, whatever the optimizer, accumulation or number of processes.
"""

import zlib
from typing import Any, Final, Protocol, runtime_checkable

import torch
import torch.distributed
from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.hand.anatomical_frame import angles_to_rotation
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.terms import Term
from hand_recon.schema import HandParameters

JOINTS: Final = 15
DIRECTIONS: Final = 10

OUTPUTS: Final = JOINTS + 2
"""Outputs of the discriminator: one per joint, one for the pose, one for the shape."""


@runtime_checkable
class RealHands(Protocol):
    """Source of real hands: a datamodule that knows the pose and shape of its training hands."""

    name: str
    """Name for messages."""

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        """Pose and shape of at most `limit` training hands; none if the data have no 3D."""
        ...


class Discriminator(nn.Module):
    """Tells real joint angles and shapes from predicted ones, part by part.

    Args:
        embedding: Number of features of a joint's rotation, from one network shared by all joints.
        width: Size of the layers over all joints together.
    """

    def __init__(self, *, embedding: int = 32, width: int = 256) -> None:
        super().__init__()
        self.embed = nn.Sequential(
            nn.Linear(9, embedding), nn.ReLU(), nn.Linear(embedding, embedding), nn.ReLU()
        )
        # The features are shared; each joint has an output layer of its own.
        self.joint_weight = nn.Parameter(torch.randn(JOINTS, embedding) / embedding**0.5)
        self.joint_bias = nn.Parameter(torch.zeros(JOINTS))
        self.pose = nn.Sequential(
            nn.Linear(JOINTS * embedding, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU(),
            nn.Linear(width, 1),
        )  # fmt: skip
        self.shape = nn.Sequential(
            nn.Linear(DIRECTIONS, DIRECTIONS), nn.ReLU(), nn.Linear(DIRECTIONS, 5), nn.ReLU(),
            nn.Linear(5, 1),
        )  # fmt: skip

    def forward(
        self,
        joint_angles: Float[Tensor, "*batch joint=15 axis=3"],
        shape: Float[Tensor, "*batch direction=10"],
    ) -> Float[Tensor, "*batch output=17"]:
        """D of every part, about 1 for real and 0 for predicted: joints, then pose, then shape.

        Args:
            joint_angles: Bend, splay and twist, radians. They enter as rotation matrices, continuous at ±π.
            shape: Coefficients of the shape directions, standard deviations.
        """
        features = self.embed(angles_to_rotation(joint_angles).flatten(-2))
        joints = (features * self.joint_weight).sum(dim=-1) + self.joint_bias
        return torch.cat([joints, self.pose(features.flatten(-2)), self.shape(shape)], dim=-1)


def generator_loss(scores: Float[Tensor, "*batch output=17"]) -> Float[Tensor, "*batch"]:
    """Loss of predicted hands, Σ(D − 1)² over the outputs.

    Args:
        scores: D of predicted hands.
    """
    return (scores - 1).square().sum(dim=-1)


def discriminator_loss(
    real: Float[Tensor, "*real output=17"], predicted: Float[Tensor, "*batch output=17"]
) -> Float[Tensor, ""]:
    """Discriminator loss: mean over real hands of Σ(D − 1)², plus mean over predicted hands of Σ D².

    Args:
        real: D of real hands.
        predicted: D of predicted hands; their number may differ.
    """
    return (real - 1).square().sum(dim=-1).mean() + predicted.square().sum(dim=-1).mean()


class Adversary(nn.Module):
    """A discriminator that is trained beside the regressor.

    Its weights, its optimizer's state and its number of steps are in its `state_dict`, so that a resumed run
    continues exactly. The real hands are not, because their data may be licensed.

    Args:
        real: Source of the real hands; none for the training data's own.
        learning_rate: Learning rate of its Adam. HMR has 1e-4 beside a network at 1e-5.
    """

    def __init__(self, real: RealHands | None = None, *, learning_rate: float = 1e-3) -> None:
        super().__init__()
        self.discriminator = Discriminator().requires_grad_(False)
        self.source = real
        self.learning_rate = learning_rate
        self._real: HandParameters | None = None
        self._steps = 0
        self._optimizer: torch.optim.Optimizer | None = None
        self._saved: dict[str, Any] = {}

    def forward(self, parameters: HandParameters) -> Float[Tensor, "*batch"]:
        """Generator loss of each hand; its gradient reaches pose and shape alone.

        Raises:
            ValueError: The discriminator is untrained and has no real hands.
        """
        if self._real is None and self._steps == 0:
            raise ValueError(
                "prior=adversarial is a discriminator that is trained beside a regressor, and this one has "
                "seen no hand. Use it with `python -m hand_recon.train`, and another prior here."
            )
        return generator_loss(self._scores(parameters))

    def set_real_hands(self, real: HandParameters) -> None:
        """Set the real hands that the discriminator is trained with.

        Args:
            real: Hands of which pose and shape are used.
        """
        self._real = real.to(self.discriminator.joint_bias)

    def learn(self, predicted: HandParameters) -> Float[Tensor, ""]:
        """One optimizer step of the discriminator on predicted hands and as many real ones.

        Args:
            predicted: Hands predicted by the regressor, which gets no gradient.

        Returns:
            The discriminator loss before the step.

        Raises:
            ValueError: There are no real hands.
        """
        if self._real is None:
            raise ValueError("There are no real hands to learn from: call `set_real_hands` first.")
        optimizer = self._get_optimizer()
        weights = tuple(self.discriminator.parameters())
        index = self._real_index(len(self._real.shape), len(predicted.shape))
        real = self._real.select(index.to(self._real.shape.device))
        self.discriminator.requires_grad_(True)
        try:
            loss = discriminator_loss(self._scores(real), self._scores(predicted.detach()))
            gradients = torch.autograd.grad(loss, weights)
        finally:
            self.discriminator.requires_grad_(False)
        for weight, gradient in zip(weights, gradients, strict=True):
            weight.grad = _averaged(gradient)
        optimizer.step()
        optimizer.zero_grad()
        self._steps += 1
        return loss.detach()

    def get_extra_state(self) -> dict[str, Any]:
        """Number of steps and optimizer state, for a checkpoint."""
        optimizer = self._saved if self._optimizer is None else self._optimizer.state_dict()
        return {"steps": self._steps, "optimizer": optimizer}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_extra_state` returned."""
        self._steps, self._saved = state["steps"], state["optimizer"]
        self._optimizer = None

    def _scores(self, parameters: HandParameters) -> Tensor:
        kind = self.discriminator.joint_bias
        return self.discriminator(parameters.joint_angles.to(kind), parameters.shape.to(kind))

    def _get_optimizer(self) -> torch.optim.Optimizer:
        """The optimizer, created at the first step, when the weights are on their device."""
        if self._optimizer is None:
            weights = self.discriminator.parameters()
            self._optimizer = torch.optim.Adam(weights, lr=self.learning_rate)
            if self._saved:
                self._optimizer.load_state_dict(self._saved)
        return self._optimizer

    def _real_index(self, known: int, count: int) -> Tensor:
        """Indices of a step's real hands, seeded by step and process so that a resumed run draws the same."""
        rank = torch.distributed.get_rank() if torch.distributed.is_initialized() else 0
        seed = zlib.crc32(repr((rank, self._steps)).encode())
        generator = torch.Generator().manual_seed(seed)
        return torch.randint(known, (count,), generator=generator)


class AdversarialTerm(Term):
    """Generator loss as a term of the prior, with its weight (`prior=adversarial`).

    Args:
        hand: The hand model.
        weight: Factor of the generator loss.
        real: Source of the real hands; none for the training data's own.
        learning_rate: Learning rate of the discriminator.
    """

    def __init__(
        self,
        hand: HandModel,
        *,
        weight: float,
        real: RealHands | None = None,
        learning_rate: float = 1e-3,
    ) -> None:
        super().__init__(hand, weight=weight)
        self.adversary = Adversary(real, learning_rate=learning_rate)

    def forward(
        self, parameters: HandParameters, vertices: Float[Tensor, "*batch vertex 3"] | None
    ) -> Float[Tensor, "*batch"]:
        """Generator loss, without unit."""
        return self.adversary(parameters)


def _averaged(gradient: Tensor) -> Tensor:
    """The mean over all processes, which keeps their weights equal."""
    if torch.distributed.is_initialized():
        torch.distributed.all_reduce(gradient)
        gradient /= torch.distributed.get_world_size()
    return gradient
