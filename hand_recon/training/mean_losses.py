"""Means of losses over the hands of many batches and of all processes."""

from typing import Any

import torch
from torch import Tensor

from hand_recon.processes import process_group


class MeanLosses:
    """Sums of losses over hands, which stay on the device until their means are asked for.

    Lightning's own means over processes divide by the mean number of hands of a process, rounded down.
    """

    def __init__(self) -> None:
        self.sums: dict[str, Tensor] = {}
        self.counts: dict[str, int] = {}

    def add(self, losses: dict[str, Tensor], hands: int) -> None:
        """Add the losses of a batch.

        Args:
            losses: Means over the batch, without a gradient, by name.
            hands: Hands of the batch.
        """
        for name, value in losses.items():
            total = value * hands
            before = self.sums.get(name)
            self.sums[name] = total if before is None else before.to(total) + total
            self.counts[name] = self.counts.get(name, 0) + hands

    def means(self) -> dict[str, Tensor]:
        """Mean of each loss over the hands of all processes that have it."""
        if process_group.count() == 1:
            return {name: total / self.counts[name] for name, total in self.sums.items()}
        names = dict.fromkeys(
            name for own in process_group.gathered(list(self.sums)) for name in own
        )
        zero = torch.zeros(()).to(next(iter(self.sums.values()), torch.zeros(())))
        sums = torch.stack([self.sums.get(name, zero) for name in names])
        counts = torch.tensor([self.counts.get(name, 0) for name in names]).to(sums)
        means = process_group.summed(sums) / process_group.summed(counts)
        return dict(zip(names, means, strict=True))

    def state(self) -> dict[str, Any]:
        """The sums and counts, for a checkpoint."""
        return {"sums": dict(self.sums), "counts": dict(self.counts)}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what `state` returned."""
        self.sums, self.counts = dict(state["sums"]), dict(state["counts"])

    def reset(self) -> None:
        """Begin anew."""
        self.sums, self.counts = {}, {}
