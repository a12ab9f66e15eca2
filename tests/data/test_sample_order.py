"""Samples dealt out to processes: the same steps as one process's, and each sample of an evaluation once."""

from itertools import chain

import pytest

from hand_recon.data.sample_order import DealtOut, EvaluationShare, SeededShuffle

CASES = [(50, 4, 2), (50, 4, 3), (12, 4, 3), (7, 1, 3), (100, 16, 1), (64, 5, 4)]
"""Samples, batch of a process, processes."""


def batches(indices: list[int], size: int) -> list[list[int]]:
    return [indices[start : start + size] for start in range(0, len(indices), size)]


@pytest.mark.parametrize(("samples", "size", "processes"), CASES)
@pytest.mark.parametrize("epoch", [0, 3])
def test_a_step_has_the_samples_of_one_process_with_all_batches(
    samples: int, size: int, processes: int, epoch: int
) -> None:
    whole = SeededShuffle(range(samples), seed=5)
    whole.set_epoch(epoch)
    expected = batches(list(whole), size * processes)
    expected = [one for one in expected if len(one) == size * processes]
    shares = [
        DealtOut(SeededShuffle(range(samples), seed=5), size, rank, processes)
        for rank in range(processes)
    ]
    for share in shares:
        share.set_epoch(epoch)
        assert len(list(share)) == len(share) == len(expected) * size
    steps = zip(*(batches(list(share), size) for share in shares), strict=True)
    assert [list(chain(*parts)) for parts in steps] == expected


def test_a_share_begins_at_any_batch() -> None:
    share = DealtOut(SeededShuffle(range(30), seed=1), 3, 1, 2)
    everything = list(share)
    share.skipped = 6
    assert list(share) == everything[6:]


@pytest.mark.parametrize(
    ("samples", "size", "processes"), [*CASES, (3, 1, 2), (11, 6, 2), (11, 4, 3), (2, 64, 2)]
)
def test_an_evaluation_has_each_sample_once_in_as_many_batches_of_each_process(
    samples: int, size: int, processes: int
) -> None:
    shares = [list(EvaluationShare(samples, size, rank, processes)) for rank in range(processes)]
    assert sorted(index for share in shares for batch in share for index in batch) == list(
        range(samples)
    )
    assert len({len(share) for share in shares}) == 1
    lengths = [len(batch) for share in shares for batch in share]
    # A batch more than is asked for only where a process would have none.
    assert min(lengths) > 0
    assert max(lengths) <= max(size, 2)


def test_fewer_samples_than_processes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"2 hands cannot be shared by 3 processes.*Lower"):
        EvaluationShare(2, 4, 0, 3)
