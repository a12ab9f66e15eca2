"""Who tests where a benchmark's own hands may not be there: one choice for every dataset that has one."""

from typing import Final

TEST_SOURCES: Final = ("auto", "evaluation", "held_out")
"""Which hands test: the benchmark's, held-out training hands, or the first of these that there is."""


def check_held_out(test_source: str, val_fraction: float) -> None:
    """Refuse a choice that does not exist.

    Args:
        test_source: One of `TEST_SOURCES`.
        val_fraction: Share of the training hands that validate; as many again may test.

    Raises:
        ValueError: It does not exist, or leaves no hands to train on.
    """
    if test_source not in TEST_SOURCES:
        raise ValueError(
            f"Unknown test_source {test_source!r}; choose one of {list(TEST_SOURCES)}."
        )
    if not 0 < val_fraction < 0.5:
        raise ValueError(
            f"val_fraction={val_fraction} must lie between 0 and 0.5, so that hands are left to train on."
        )
