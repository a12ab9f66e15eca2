"""A prior learnt from 3D data: a discriminator tells predicted hands from real ones (Sec. 5, Table 3 (a)).

To compare knowledge from books with. As in HMR (Kanazawa et al., CVPR 2018), whom the paper follows there,
several small judges look at parts of a hand: one at each joint's rotation, one at all joints together and one
at the shape. They learn by least squares (Mao et al., ICCV 2017): 1 for real, 0 for predicted.

The discriminator's weights never ask for a gradient except in its own step, so the loss of a network that is
judged flows through them into pose and shape alone, whatever optimizer, accumulation or number of processes.
"""

import zlib
from typing import Any, Final, Protocol, runtime_checkable

import torch
import torch.distributed
from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.hand.anatomical_frame import angles_to_rotation
from hand_recon.schema import HandParameters

JOINTS: Final = 15
DIRECTIONS: Final = 10

JUDGES: Final = JOINTS + 2
"""One per joint, one for the pose, one for the shape."""


@runtime_checkable
class RealHands(Protocol):
    """Where real hands come from: any datamodule that knows the pose and shape of its training hands."""

    name: str

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        """At most so many of them; none where the data have no 3D."""
        ...


class Discriminator(nn.Module):
    """Judges a hand's joint angles and shape, part by part.

    Args:
        embedding: Features of a joint's rotation, made by one network for all joints.
        width: Of the layers that look at all joints together.
    """

    def __init__(self, *, embedding: int = 32, width: int = 256) -> None:
        super().__init__()
        self.embed = nn.Sequential(
            nn.Linear(9, embedding), nn.ReLU(), nn.Linear(embedding, embedding), nn.ReLU()
        )
        # Each joint has a judge of its own over the features that all share.
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
    ) -> Float[Tensor, "*batch judge=17"]:
        """About 1 for what looks real and about 0 for what does not: joints, then pose, then shape.

        Args:
            joint_angles: Bend, splay and twist, radians. Judged as rotations, which have no seam.
            shape: Standard deviations.
        """
        features = self.embed(angles_to_rotation(joint_angles).flatten(-2))
        joints = (features * self.joint_weight).sum(dim=-1) + self.joint_bias
        return torch.cat([joints, self.pose(features.flatten(-2)), self.shape(shape)], dim=-1)


def judged_loss(judgement: Float[Tensor, "*batch judge=17"]) -> Float[Tensor, "*batch"]:
    """What a hand costs whoever predicted it: every judge's squared distance from 1, summed."""
    return (judgement - 1).square().sum(dim=-1)


def judges_loss(
    real: Float[Tensor, "*real judge=17"], predicted: Float[Tensor, "*batch judge=17"]
) -> Float[Tensor, ""]:
    """What the discriminator pays: real hands' distance from 1 and predicted ones' from 0, squared.

    Args:
        real: Judgements of real hands.
        predicted: Of predicted ones, perhaps of another number.
    """
    return (real - 1).square().sum(dim=-1).mean() + predicted.square().sum(dim=-1).mean()


class Adversary(nn.Module):
    """A discriminator that learns beside the network that it judges.

    Its weights, its optimizer's state and the number of its steps are all in its `state_dict`, so that a run
    goes on where it stopped. The real hands are not: they belong to whoever has the data.

    Args:
        real: Whose hands are the real ones, if not the training data's own.
        learning_rate: Of its Adam. HMR has 1e-4 beside a network at 1e-5.
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
        """What each hand costs; the gradient reaches pose and shape alone.

        Raises:
            ValueError: The discriminator has never seen a hand.
        """
        if self._real is None and self._steps == 0:
            raise ValueError(
                "prior=adversarial judges by what it learns while a network is trained beside it, and this "
                "one has seen no hand. Use it with `python -m hand_recon.train`, and another prior here."
            )
        return judged_loss(self._judge(parameters))

    def meet(self, real: HandParameters) -> None:
        """Remember the real hands.

        Args:
            real: Of which pose and shape are looked at.
        """
        self._real = real.to(self.discriminator.joint_bias)

    def learn(self, predicted: HandParameters) -> Float[Tensor, ""]:
        """One step of the discriminator on predicted hands and as many real ones.

        Args:
            predicted: By the network that is judged; it gets no gradient.

        Returns:
            The loss before the step.

        Raises:
            ValueError: There are no real hands.
        """
        if self._real is None:
            raise ValueError("There are no real hands to learn from: call `meet` first.")
        optimizer = self._ready()
        weights = tuple(self.discriminator.parameters())
        known = len(self._real.shape)
        real = self._real.select(
            self._places(known, len(predicted.shape)).to(self._real.shape.device)
        )
        self.discriminator.requires_grad_(True)
        try:
            loss = judges_loss(self._judge(real), self._judge(predicted.detach()))
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
        """What a checkpoint keeps beside the weights."""
        optimizer = self._saved if self._optimizer is None else self._optimizer.state_dict()
        return {"steps": self._steps, "optimizer": optimizer}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Go on from there with the next step."""
        self._steps, self._saved = state["steps"], state["optimizer"]
        self._optimizer = None

    def _judge(self, parameters: HandParameters) -> Tensor:
        kind = self.discriminator.joint_bias
        return self.discriminator(parameters.joint_angles.to(kind), parameters.shape.to(kind))

    def _ready(self) -> torch.optim.Optimizer:
        """The optimizer, made with the first step: only then the weights are on their device."""
        if self._optimizer is None:
            weights = self.discriminator.parameters()
            self._optimizer = torch.optim.Adam(weights, lr=self.learning_rate)
            if self._saved:
                self._optimizer.load_state_dict(self._saved)
        return self._optimizer

    def _places(self, known: int, count: int) -> Tensor:
        """Which real hands: by step and process, so that a resumed run sees the same ones."""
        rank = torch.distributed.get_rank() if torch.distributed.is_initialized() else 0
        seed = zlib.crc32(repr((rank, self._steps)).encode())
        generator = torch.Generator().manual_seed(seed)
        return torch.randint(known, (count,), generator=generator)


def _averaged(gradient: Tensor) -> Tensor:
    """The mean over all processes, which so keep the same weights."""
    if torch.distributed.is_initialized():
        torch.distributed.all_reduce(gradient)
        gradient /= torch.distributed.get_world_size()
    return gradient
