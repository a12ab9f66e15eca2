"""Suites of the benchmark: each module measures one part and yields its rows."""

from typing import Final

SUITES: Final = (
    "layer", "physics", "step", "fit", "inference", "evaluation", "data", "startup", "scaling",
)  # fmt: skip
"""Names of the suites, each a module here with a function `measure`."""
