"""Training of a lifter on 2D landmarks alone: likelihood, knowledge, and its own hands seen from elsewhere.

The 2D labels of a view say nothing about depth. Knowledge excludes impossible depths. The rest is learnt from
views of other hands: every hand that the lifter made of a view is turned, looked at from a random direction,
and has to be made again. What is hidden in depth from one side is plain from another, so that the lifter
learns which of the possible hands are common (after Chen et al., Unsupervised 3D pose estimation with
geometric self-supervision, CVPR 2019). No 3D label of any data is used.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.prior import Prior
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.lifter_file import LifterSettings
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.training.schedules import warmup_cosine
from hand_recon.uncertainty import NegativeLogLikelihood, SquaredError, Staged
from lifter_training.poses import Poses
from lifter_training.views import Noise, Views, sample_views


@dataclass(frozen=True)
class Training:
    """Settings of a training run."""

    steps: int = 14_000
    """Optimizer steps."""
    views: int = 64
    """Views of made-up hands per step."""
    own: int = 32
    """Views of the lifter's own hands per step."""
    own_from: float = 0.1
    """Share of the steps before the lifter's own hands are used."""
    own_weight: float = 500_000.0
    """Weight of the squared distances of its own hands, per square metre: 1 mm counts as much as 0.7 px."""
    learning_rate: float = 1e-3
    """Highest learning rate; it rises over a hundred steps and falls to zero as a cosine."""
    longest_gradient: float = 3e5
    """Norm to which gradients are clipped (decision 49)."""
    seed: int = 0
    """Seed of everything."""
    network: LifterSettings = field(default_factory=lambda: LifterSettings(confidence=False))
    """The network."""
    poses: Poses = field(default_factory=Poses)
    """The hands."""
    noise: Noise = field(default_factory=Noise)
    """The views."""


Report = Callable[[str], None]


class Trainer:
    """Trains a lifter on views of hands.

    Args:
        hands: Landmarks of hands in the hand's frame, metres. Only their projections are labels.
        hand: Hand model.
        prior: Knowledge of hands; its terms that need a surface are left out.
        training: Settings.
    """

    def __init__(
        self,
        hands: Float[Tensor, "hand landmark=21 3"],
        hand: HandModel,
        prior: Prior,
        training: Training,
    ) -> None:
        self.hands, self.prior, self.training = hands, prior, training
        self.generator = torch.Generator().manual_seed(training.seed)
        torch.manual_seed(training.seed)
        self.lifter: Regressor = training.network.build(hand.landmarks_only())
        # Labels belong to the camera of each view.
        self.lifter.use_intrinsics = True
        self.data_term = Staged(
            SquaredError(), NegativeLogLikelihood(), switch_at=0.5, keep_balance=True
        )
        parameters = list(self.lifter.parameters())
        self.optimizer = torch.optim.AdamW(
            parameters, training.learning_rate, weight_decay=1e-4, fused=True
        )
        self.schedule = warmup_cosine(self.optimizer, training.steps)
        self.own: Float[Tensor, "hand landmark=21 3"] | None = None

    def run(self, report: Report = print) -> Regressor:
        """Take all steps.

        Args:
            report: Called with a line of progress twenty times.

        Raises:
            FloatingPointError: The loss is not finite.
        """
        began = time.monotonic()
        self.lifter.train()
        for step in range(self.training.steps):
            losses = self.step(step)
            if not losses["total"].isfinite():
                raise FloatingPointError(
                    f"The loss is not finite at step {step}: {losses}. Lower the learning rate."
                )
            if step % max(self.training.steps // 20, 1) == 0:
                shown = ", ".join(f"{name} {float(value):.0f}" for name, value in losses.items())
                report(f"step {step}, {time.monotonic() - began:.0f} s: {shown}")
        return self.lifter.eval()

    def step(self, step: int) -> dict[str, Tensor]:
        """Take one step; terms of the loss, weighted, and their sum as `total`.

        Args:
            step: Steps before this one.
        """
        drawn = torch.randint(len(self.hands), (self.training.views,), generator=self.generator)
        views = [sample_views(self.hands[drawn], self.training.noise, self.generator)]
        if self.own is not None:
            views.append(sample_views(self.own, self.training.noise, self.generator))
        found = self._predict(views, step)
        losses = self._losses(views, found)
        self.optimizer.zero_grad()
        losses["total"].backward()
        torch.nn.utils.clip_grad_norm_(self.lifter.parameters(), self.training.longest_gradient)
        self.optimizer.step()
        self.schedule.step()
        if step >= self.training.own_from * self.training.steps:
            self.own = self._own_hands(found)
        return {name: value.detach() for name, value in losses.items()}

    def _predict(self, views: list[Views], step: int) -> HandPrediction:
        """Predict the hands of views; σ starts at the residual when the likelihood begins (decision 28)."""
        batch = _joined([view.seen for view in views])
        with torch.autocast("cpu", torch.bfloat16):
            found: HandPrediction = self.lifter(batch)
        term, total = self.data_term, self.training.steps
        if term.stage == 0 and term.begin(step=step, epoch=0, total_steps=total):
            start = term.running_log_sigma() - found.log_sigma.detach().mean(dim=0)
            self.lifter.shift_log_sigma(start)
            found = self.lifter(batch)
        return found

    def _losses(self, views: list[Views], found: HandPrediction) -> dict[str, Tensor]:
        exact = torch.cat([view.exact for view in views])
        # All landmarks have labels, also those that the lifter does not see (decision 31).
        labelled = torch.ones_like(exact[..., 0], dtype=torch.bool)
        # Hands that a first step throws out of the crop must not decide everything.
        residual = (found.landmarks_2d - exact).clamp(-400, 400)
        self.data_term.observe(residual, labelled)
        losses = {"data": self.data_term(residual, found.log_sigma, labelled).mean()}
        knowledge = self.prior.weighted(self.prior(found.parameters))
        losses |= {name: value.mean() for name, value in knowledge.items()}
        if len(views) > 1:
            again = found.landmarks_3d[-len(views[1].exact) :]
            distance = _centred(again) - _centred(views[1].points)
            share = len(again) / len(exact)
            squares = distance.square().sum(dim=(1, 2)).mean()
            losses["own hands"] = self.training.own_weight * share * squares
        return losses | {"total": torch.stack(list(losses.values())).sum()}

    @torch.no_grad()
    def _own_hands(self, found: HandPrediction) -> Float[Tensor, "hand landmark=21 3"]:
        """Landmarks of some predicted hands in the hand's frame, metres."""
        count = self.training.views
        drawn = torch.randperm(count, generator=self.generator)[: self.training.own]
        some = found.select(drawn)
        placed = some.landmarks_3d - some.parameters.translation[:, None]
        return placed @ some.parameters.root_rotation


def _centred(points: Float[Tensor, "hand landmark=21 3"]) -> Float[Tensor, "hand landmark=21 3"]:
    return points - points.mean(dim=1, keepdim=True)


def _joined(batches: list[HandBatch]) -> HandBatch:
    """Batches of views behind each other."""
    cameras = [batch.intrinsics for batch in batches if batch.intrinsics is not None]
    count = sum(len(batch) for batch in batches)
    return HandBatch(
        image=torch.cat([batch.image for batch in batches]),
        landmarks_2d=torch.cat([batch.landmarks_2d for batch in batches]),
        labelled=torch.cat([batch.labelled for batch in batches]),
        index=torch.arange(count),
        source=("",) * count,
        intrinsics=torch.cat(cameras),
    )
