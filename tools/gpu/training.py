"""Training of one row within a time limit, on crops in the device's memory (Sec. 3.4)."""

import math
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Int
from torch import Tensor, nn

from gpu.resident import ResidentHands
from gpu.rows import CLIP
from hand_recon.data.augment import Augmentation
from hand_recon.knowledge.penetration.places import warn_of_left_out
from hand_recon.schema import HandBatch
from hand_recon.training.module import HandReconstruction, reference_residual
from hand_recon.training.non_finite import Arriving

UNCOUNTED: Final = 10
"""First steps, which are not counted in the speed."""

_PARTS: Final = 1_000_000
"""Parts of a row's time, as which a data term with stages sees the share that has passed."""


@dataclass(frozen=True)
class Plan:
    """Limits and settings of a row."""

    seconds: float
    """Time limit; the learning rate falls to zero at its end."""
    steps: int | None = None
    """Number of steps, if the learning rate is to follow them; the time limit holds all the same."""
    batch_size: int = 256
    """Hands per step."""
    rendered_share: float = 0.15
    """Share of rendered hands in each batch, if there are any."""
    warmup: int = 100
    """Steps in which the learning rate rises."""
    seed: int = 0
    """Seed of the order of the hands and of the augmentation."""
    every: float = 5.0
    """Seconds between two lines of progress."""


@dataclass(frozen=True)
class Trained:
    """Facts about a row's training."""

    steps: int
    """Steps taken."""
    seconds: float
    """Time taken."""
    images_per_second: float
    """Crops augmented and learnt from, per second after the first `UNCOUNTED` steps."""
    stage: int
    """Stage of the data term at the end."""
    curve: tuple[dict[str, float], ...]
    """Losses of single batches, about every `Plan.every` seconds."""


@dataclass(frozen=True)
class Order:
    """Rows of each batch: real hands in a new order each time, then rendered ones at random."""

    real: int
    """Number of real hands, which come first."""
    rendered: int
    """Number of rendered hands, which follow."""
    plan: Plan
    """Batch size, share of rendered hands and seed."""

    def __iter__(self) -> Iterator[Int[Tensor, " batch"]]:
        """Endless batches of rows, on the CPU."""
        plan = self.plan
        added = round(plan.rendered_share * plan.batch_size) if self.rendered else 0
        generator = torch.Generator().manual_seed(seed_of(plan.seed, "order"))
        waiting = torch.empty(0, dtype=torch.int64)
        while True:
            while len(waiting) < plan.batch_size - added:
                waiting = torch.cat([waiting, torch.randperm(self.real, generator=generator)])
            chosen, waiting = waiting.tensor_split([plan.batch_size - added])
            if added:
                more = torch.randint(self.rendered, (added,), generator=generator)
                chosen = torch.cat([chosen, self.real + more])
            yield chosen


def seed_of(*words: object) -> int:
    """Seed that depends on words and numbers only."""
    return zlib.crc32(repr(words).encode())


def augmented(batch: HandBatch, augmentation: Augmentation, seed: int) -> HandBatch:
    """An augmented copy of a batch, all of whose random numbers are drawn on its own device.

    Drawn on the CPU, the sensor noise alone would take longer than the network.

    Args:
        batch: Batch with images as bytes.
        augmentation: Ranges of the draws.
        seed: Seed of the draws; another kind of device has other draws.
    """
    device = batch.landmarks_2d.device
    generator = torch.Generator(device).manual_seed(seed)
    # Tensors made without naming a device are then made there.
    with torch.device(device):
        return augmentation(batch, generator)


def learning_rate_factor(step: int, share: float, warmup: int) -> float:
    """Linear warm-up by steps, then a cosine to zero at the end of the time.

    Args:
        step: Steps taken.
        share: Share of the time that has passed, 0 to 1.
        warmup: Steps of the warm-up.
    """
    return min(1.0, (step + 1) / warmup) * 0.5 * (1 + math.cos(math.pi * min(1.0, share)))


def train_row(
    module: HandReconstruction,
    hands: ResidentHands,
    rendered: ResidentHands | None,
    augmentation: Augmentation,
    plan: Plan,
) -> Trained:
    """Train until the time or the steps are over.

    Args:
        module: Network, losses and optimizer, on the device.
        hands: Training hands on this device.
        rendered: Rendered hands; None without any.
        augmentation: Of the training crops.
        plan: Limits and settings.

    Raises:
        FloatingPointError: The loss is not finite.
    """
    joined = hands if rendered is None else hands.followed_by(rendered)
    order = Order(len(hands), 0 if rendered is None else len(rendered), plan)
    row = _Row(module.train(), augmentation, plan)
    for step, index in enumerate(order):
        if not row.goes_on(step):
            break
        row.step(step, joined.batch(index))
    return row.ended()


class _Row:
    """State of a row's training."""

    def __init__(self, module: HandReconstruction, augmentation: Augmentation, plan: Plan) -> None:
        self.module, self.augmentation, self.plan = module, augmentation, plan
        self.learning: list[nn.Parameter] = [p for p in module.parameters() if p.requires_grad]
        self.optimizer = module.optimizer(self.learning)
        self.highest = float(self.optimizer.param_groups[0]["lr"])
        self.began = self.counted_from = self.told = time.monotonic()
        self.steps = 0
        self.waiting: tuple[dict[str, Tensor], HandBatch, Arriving] | None = None
        self.curve: list[dict[str, float]] = []

    def share(self, step: int) -> float:
        """Share of the row that has passed, by its steps or by its time."""
        if self.plan.steps is not None:
            return step / self.plan.steps
        return (time.monotonic() - self.began) / self.plan.seconds

    def goes_on(self, step: int) -> bool:
        """True if another step is to be taken."""
        if step == UNCOUNTED:
            _finish_work(self.module.device)
            self.counted_from = time.monotonic()
        return self.share(step) < 1 and time.monotonic() - self.began < self.plan.seconds

    def step(self, step: int, batch: HandBatch) -> None:
        """Take a step, and check the loss of the step before it.

        It was copied while the device went on, so that nothing waits for this step.
        """
        module, share = self.module, self.share(step)
        batch = augmented(batch, self.augmentation, seed_of(self.plan.seed, step))
        factor = learning_rate_factor(step, share, self.plan.warmup)
        for group in self.optimizer.param_groups:
            group["lr"] = self.highest * factor
        prediction = module(batch)
        if self._stage_begins(share):
            start = module.data_term.running_log_sigma()
            module.regressor.shift_log_sigma(start - prediction.log_sigma.detach().mean(dim=0))
            prediction = module(batch)
        module.data_term.observe(reference_residual(batch, prediction), batch.labelled)
        losses = module.losses(batch, prediction)
        self.optimizer.zero_grad(set_to_none=True)
        losses["loss"].backward()
        nn.utils.clip_grad_norm_(self.learning, CLIP)
        self.optimizer.step()
        self._check()
        detached = {name: value.detach() for name, value in losses.items()}
        self.waiting = detached, batch, Arriving(torch.isfinite(detached["loss"]))
        self.steps = step + 1
        self._tell(share)

    def ended(self) -> Trained:
        """Facts about the training, once the device has done all of it.

        Raises:
            FloatingPointError: The last loss is not finite.
        """
        self._check()
        _finish_work(self.module.device)
        warn_of_left_out(self.module.prior)
        now = time.monotonic()
        counted = self.steps - UNCOUNTED if self.steps > UNCOUNTED else self.steps
        counted_from = self.counted_from if self.steps > UNCOUNTED else self.began
        return Trained(
            steps=self.steps,
            seconds=now - self.began,
            images_per_second=counted * self.plan.batch_size / max(now - counted_from, 1e-9),
            stage=self.module.data_term.stage,
            curve=tuple(self.curve),
        )

    def _stage_begins(self, share: float) -> bool:
        term = self.module.data_term
        if term.stages == 1 or term.stage == term.stages - 1:
            return False
        return term.begin(step=int(share * _PARTS), epoch=0, total_steps=_PARTS)

    def _check(self) -> None:
        """Refuse a loss that is not finite."""
        if self.waiting is None:
            return
        losses, batch, finite = self.waiting
        if not finite.read():
            values = {name: float(value) for name, value in losses.items()}
            raise FloatingPointError(
                f"The loss is not finite at step {self.steps - 1}: {values}. The batch held "
                f"{list(batch.source[:8])}. Lower the learning rate (--learning-rate), or look at "
                "these hands."
            )

    def _tell(self, share: float) -> None:
        """Print and keep the losses of this step, if it is time to."""
        now = time.monotonic()
        if self.waiting is None or (now - self.told < self.plan.every and self.steps > 1):
            return
        values = {name: float(value) for name, value in self.waiting[0].items()}
        speed = self.steps * self.plan.batch_size / (now - self.began)
        shown = "  ".join(
            f"{name} {value:.4g}" for name, value in values.items() if "/" not in name
        )
        left = max(0.0, self.plan.seconds - (now - self.began))
        print(f"  step {self.steps}  {speed:.0f} images/s  {shown}  {left:.0f} s left", flush=True)
        self.curve.append({"step": float(self.steps), "share": share, **values})
        self.told = time.monotonic()


def _finish_work(device: torch.device) -> None:
    """Wait until a GPU has done what it was told."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
