"""Choosing some samples of a dataset."""


def evenly_spaced(length: int, limit: int) -> list[int]:
    """Indices spread evenly over a sequence, the first one included, in ascending order.

    >>> evenly_spaced(10, 4)
    [0, 2, 5, 7]

    Args:
        length: Length of the sequence.
        limit: Number of indices; a sequence that is shorter gives all of its own.
    """
    count = min(length, limit)
    return [position * length // count for position in range(count)]
