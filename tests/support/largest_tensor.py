"""The size of the largest tensor that a piece of code makes."""

from typing import Any

from torch import Tensor

from tests.support.watched import Watched


class LargestTensor(Watched):
    """Context that records the number of elements of the largest tensor made in it."""

    def __init__(self) -> None:
        super().__init__()
        self.numbers = 0

    def look(
        self, operation: object, args: tuple[Any, ...], named: dict[str, Any], result: object
    ) -> None:
        """Record the size of a result."""
        if isinstance(result, Tensor):
            self.numbers = max(self.numbers, result.numel())
