"""The tests, and the type checker that pytest puts around every function of `hand_recon`."""

from typing import Any, Self

from beartype import BeartypeConf, FrozenDict, beartype

check = beartype(
    conf=BeartypeConf(
        # An int may be passed for a float, as type checkers have it.
        is_pep484_tower=True,
        # beartype knows `Self` in decorated classes only, and jaxtyping decorates methods.
        hint_overrides=FrozenDict({Self: Any}),
    )
)
