"""Contexts that look at every operation of torch in them."""

from collections.abc import Callable
from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode


class Watched(TorchDispatchMode):
    """Context that runs every operation and then looks at it; a subclass says how."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]

    def __torch_dispatch__(
        self,
        func: Callable[..., Any],
        types: object,
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
    ) -> Any:  # noqa: ANN401
        """Run an operation and look at it."""
        result = func(*args, **(kwargs or {}))
        self.look(func, args, kwargs or {}, result)
        return result

    def look(
        self, operation: object, args: tuple[Any, ...], named: dict[str, Any], result: object
    ) -> None:
        """Look at an operation with its arguments and its result."""
        raise NotImplementedError


class GradientPrecisions(Watched):
    """Collects the precisions of gradients of convolutions by the number of their groups."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[int, torch.dtype]] = []

    def look(
        self, operation: object, args: tuple[Any, ...], named: dict[str, Any], result: object
    ) -> None:
        """Note a convolution's gradient."""
        del named, result
        if operation is torch.ops.aten.convolution_backward.default:
            self.seen.append((int(args[9]), args[0].dtype))
