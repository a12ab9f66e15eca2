"""A step on a device without values, where whatever a GPU would be waited for is an error."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._pytree import tree_leaves

from tests.support.watched import Watched

META: Final = torch.device("meta")
"""Tensors there have a shape and no values: reading one, or a length that depends on one, is an error."""

_OF_HOST: Final = ("tensor", "as_tensor", "new_tensor")
"""Functions that copy numbers of the processor to a device, which torch waits for."""


class _Copies(TorchFunctionMode):
    """Refuses lists as indices and numbers of the processor, which would be copied at each use."""

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: object,
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
    ) -> Any:  # noqa: ANN401
        name = getattr(func, "__name__", "")
        result = func(*args, **(kwargs or {}))
        if name in {"__getitem__", "__setitem__"} and args[0].device == META and _listed(args[1]):
            raise AssertionError(f"A list of indices is copied to the device: {args[1]}")
        if name in _OF_HOST and result.device == META:
            raise AssertionError(f"Numbers of the processor are copied to the device: {args}")
        return result


def _listed(index: object) -> bool:
    parts = index if isinstance(index, tuple) else (index,)
    return any(isinstance(part, (list, tuple, range)) for part in parts)


class _Transfers(Watched):
    """Refuses operations between tensors of the processor and of the device, single numbers excepted."""

    def look(
        self, operation: object, args: tuple[Any, ...], named: dict[str, Any], result: object
    ) -> None:
        given = [one for one in tree_leaves((args, named)) if isinstance(one, Tensor)]
        made = [one for one in tree_leaves(result) if isinstance(one, Tensor)]
        here = [one for one in given if one.device.type == "cpu" and one.dim()]
        if here and any(one.device == META for one in given + made):
            raise AssertionError(f"{operation} takes a tensor of the processor to the device.")


@contextmanager
def nothing_is_copied() -> Iterator[None]:
    """Refuse copies between processor and device, too; a device without values refuses all else."""
    with _Transfers(), _Copies():
        yield
