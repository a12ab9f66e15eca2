"""Weights of a network as safetensors in half precision, in several files where one would be too large."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from hand_recon.regressor.error_feedback import Regressor

_OF_THE_HAND: Final = ("hand.", "skeleton.")
"""Prefixes of tensors of the hand model, which the package has."""


def save_weights(
    stem: Path, network: Regressor, header: Mapping[str, str], largest: int
) -> list[Path]:
    """Write the weights of a network, without its hand model.

    Args:
        stem: Path of the file without its ending.
        network: The network, on any device.
        header: Entries of the header of each file.
        largest: Largest size of a file, bytes; a tensor that is larger has a file of its own.

    Returns:
        The files: `<stem>.safetensors`, or `<stem>-1-of-3.safetensors` and so on.
    """
    parts: list[dict[str, Tensor]] = [{}]
    room = largest
    for name, tensor in network.state_dict().items():
        if name.startswith(_OF_THE_HAND):
            continue
        kept = _halved(tensor.detach().cpu()).contiguous()
        if kept.nbytes > room and parts[-1]:
            parts.append({})
            room = largest
        parts[-1][name] = kept
        room -= kept.nbytes
    stem.parent.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, part in enumerate(parts, start=1):
        suffix = "" if len(parts) == 1 else f"-{number}-of-{len(parts)}"
        paths.append(stem.with_name(f"{stem.name}{suffix}.safetensors"))
        save_file(part, paths[-1], dict(header))
    return paths


def load_weights(paths: Sequence[Path], network: Regressor) -> None:
    """Read the weights that `save_weights` wrote into a network of the same settings.

    Args:
        paths: All files of the network.
        network: The network; its hand model stays as it is.

    Raises:
        ValueError: Weights are missing, or some are of another network.
    """
    found: dict[str, Tensor] = {}
    for path in paths:
        found |= load_file(path)
    own = network.state_dict()
    wanted = {name for name in own if not name.startswith(_OF_THE_HAND)}
    other = sorted(wanted ^ set(found))
    if other:
        raise ValueError(
            f"{len(found)} tensors in {', '.join(map(str, paths))}, and the network has {len(wanted)}; the "
            f"first that is not in both: {other[0]}. Give all files of a network of the same settings."
        )
    network.load_state_dict(own | found)


def _halved(tensor: Tensor) -> Tensor:
    """The tensor in half precision; as it is, where that cannot hold its numbers."""
    if tensor.dtype != torch.float32:
        return tensor
    halved = tensor.half()
    return halved if halved.isfinite().all() else tensor
