"""Order of hands by shards: every hand once, few shards at a time, shards of its own for each stream."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data.shards.order import Mixing, ShardShuffle, shard_order

SIZES = st.lists(st.integers(1, 30), min_size=1, max_size=12)


def starts_of(sizes: list[int]) -> np.ndarray:
    return np.cumsum([0, *sizes])


@given(SIZES, st.integers(1, 5), st.integers(1, 4), st.integers(1, 7))
def test_every_hand_comes_once(sizes: list[int], at_once: int, streams: int, turn: int) -> None:
    mixing = Mixing(at_once, streams, turn)
    order = shard_order(starts_of(sizes), torch.Generator().manual_seed(3), mixing)
    assert sorted(order.tolist()) == list(range(sum(sizes)))


@given(SIZES, st.integers(1, 5))
def test_no_more_shards_than_wanted_are_open(sizes: list[int], at_once: int) -> None:
    starts = starts_of(sizes)
    order = shard_order(starts, torch.Generator().manual_seed(1), Mixing(at_once))
    shards = (np.searchsorted(starts, order, side="right") - 1).tolist()
    spans = [(shards.index(one), len(shards) - shards[::-1].index(one)) for one in set(shards)]
    for place in range(len(shards)):
        assert sum(first <= place < end for first, end in spans) <= at_once


def test_streams_take_turns_by_batches_and_share_no_shard_but_at_their_bounds() -> None:
    # Twelve shards of ten hands for three streams: four whole shards each.
    starts = starts_of([10] * 12)
    order = shard_order(starts, torch.Generator().manual_seed(2), Mixing(2, 3, 5))
    batches = order.reshape(8, 3, 5)
    shards = [set((batches[:, stream] // 10).ravel().tolist()) for stream in range(3)]
    assert [len(one) for one in shards] == [4, 4, 4]
    assert set.union(*shards) == set(range(12))


def test_what_fills_no_turn_comes_last() -> None:
    order = shard_order(starts_of([7]), torch.Generator().manual_seed(2), Mixing(1, 2, 2))
    # Streams of 3 and 4 hands: one turn of two each, then one and two hands.
    assert len(order) == 7
    assert len(set(order.tolist())) == 7


def test_the_order_is_that_of_the_seed_and_the_epoch() -> None:
    def order(seed: int, epoch: int) -> list[int]:
        sampler = ShardShuffle(starts_of([20, 30]), seed, Mixing())
        sampler.set_epoch(epoch)
        return list(sampler)

    assert order(1, 2) == order(1, 2)
    assert len({tuple(order(seed, epoch)) for seed in (1, 2) for epoch in (0, 1)}) == 4


def test_a_dealt_out_order_gives_each_process_its_stream() -> None:
    sample_order = pytest.importorskip("hand_recon.data.sample_order")
    starts = starts_of([8] * 6)
    whole = ShardShuffle(starts, 4, Mixing(1, 2, 4))
    shares = [list(sample_order.DealtOut(whole, 4, process, 2)) for process in range(2)]
    assert sorted(shares[0] + shares[1]) == list(range(48))
    assert not {index // 8 for index in shares[0]} & {index // 8 for index in shares[1]}


def test_numbers_below_one_are_refused() -> None:
    for numbers in ((0, 1, 1), (1, 0, 1), (1, 1, 0)):
        with pytest.raises(ValueError, match="expected all to be 1 or more"):
            Mixing(*numbers)
