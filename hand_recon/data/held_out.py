"""Choice of test hands for datasets whose benchmark hands may be missing."""

from typing import Final

TEST_SOURCES: Final = ("auto", "evaluation", "held_out")
"""Sources of test hands: the benchmark's, held-out training hands, or the first that is available."""


def check_held_out(test_source: str, val_fraction: float) -> None:
    """Check the source of test hands and the share of validation hands.

    Args:
        test_source: One of `TEST_SOURCES`.
        val_fraction: Share of the training hands used for validation; as many again may be used for testing.

    Raises:
        ValueError: The source is unknown, or no hands are left to train on.
    """
    if test_source not in TEST_SOURCES:
        raise ValueError(
            f"Unknown test_source {test_source!r}; choose one of {list(TEST_SOURCES)}."
        )
    if not 0 < val_fraction < 0.5:
        raise ValueError(
            f"val_fraction={val_fraction} must lie between 0 and 0.5, so that hands are left to train on."
        )
