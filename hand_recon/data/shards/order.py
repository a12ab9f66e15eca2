"""Order of the hands of an epoch by which few shards are needed at the same time (decision 98).

The order is a function of seed, epoch, number of streams and batch size, with every hand once.
Streams take turns by batches: dealt out to as many processes (`hand_recon.data.sample_order.DealtOut`), each
process reads shards of its own.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Int

from hand_recon.data.sample_order import EpochSampler


@dataclass(frozen=True)
class Mixing:
    """Settings of the order.

    Raises:
        ValueError: A number is below 1.
    """

    at_once: int = 4
    """Shards whose hands are mixed."""
    streams: int = 1
    """Number of parts of an epoch that read shards of their own."""
    turn: int = 1
    """Hands of a stream before it is another stream's turn: those of a batch."""

    def __post_init__(self) -> None:
        if min(self.at_once, self.streams, self.turn) < 1:
            raise ValueError(
                f"shards_at_once={self.at_once}, streams={self.streams} and batch_size={self.turn}; expected "
                "all to be 1 or more."
            )


class ShardShuffle(EpochSampler):
    """Sampler that draws shards, and within each few of them hands."""

    def __init__(self, starts: Int[np.ndarray, " bound"], seed: int, mixing: Mixing) -> None:
        """Store the settings.

        Args:
            starts: First position of each shard in the dataset, and the dataset's length.
            seed: Seed of the order.
            mixing: Further settings.
        """
        super().__init__(seed)
        self.starts = starts
        self.mixing = mixing

    def order(self) -> list[int]:
        """A permutation of all positions."""
        return list(shard_order(self.starts, self.generator(), self.mixing).tolist())

    def __len__(self) -> int:
        return int(self.starts[-1])


def shard_order(
    starts: Int[np.ndarray, " bound"], generator: torch.Generator, mixing: Mixing
) -> Int[np.ndarray, " hand"]:
    """A permutation of positions in which each stream reads its shards one group after another.

    The shards are drawn in an order, which is cut into one part of equal length for each stream; in each
    part, the hands of `at_once` shards are mixed.

    Args:
        starts: First position of each shard, and the number of positions.
        generator: Random numbers.
        mixing: Settings.
    """
    drawn = torch.randperm(len(starts) - 1, generator=generator).tolist()
    pieces = [
        starts[shard]
        + torch.randperm(int(starts[shard + 1] - starts[shard]), generator=generator).numpy()
        for shard in drawn
    ]
    ends = np.cumsum([len(piece) for piece in pieces])
    hands = np.concatenate(pieces)
    bounds = np.arange(mixing.streams + 1) * len(hands) // mixing.streams
    for start, stop in itertools.pairwise(bounds):
        # Ends of the shards inside this stream's part, of which every at_once-th ends a group.
        inner = ends[(ends > start) & (ends < stop)][mixing.at_once - 1 :: mixing.at_once]
        for part in np.split(hands[start:stop], inner - start):
            part[:] = part[torch.randperm(len(part), generator=generator).numpy()]
    return _in_turns(hands, bounds, mixing.turn)


def _in_turns(
    hands: Int[np.ndarray, " hand"], bounds: Int[np.ndarray, " bound"], turn: int
) -> Int[np.ndarray, " hand"]:
    """The first hands of each stream, then the next ones of each, …; what fills no turn is at the end."""
    turns = int(np.diff(bounds).min()) // turn
    used = turns * turn
    full = [hands[start : start + used].reshape(turns, turn) for start in bounds[:-1]]
    rest = [hands[start + used : end] for start, end in itertools.pairwise(bounds)]
    return np.concatenate([np.stack(full, axis=1).ravel(), *rest])
