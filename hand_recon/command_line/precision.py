"""Precision in which a machine trains a network for images fastest (decision 101).

PyTorch is loaded only by the functions that need it, since every command registers them as resolvers.
"""

import re
from typing import Final

SINGLE: Final = "32-true"
"""Lightning's name of single precision."""

MIXED: Final = "bf16-mixed"
"""Lightning's name of convolutions and products in bfloat16 with weights in single precision."""

_FAST: Final = re.compile(r"efficientnet_lite0|resnet\d+")
"""Backbones that bfloat16 makes faster on processors; depthwise convolutions of others make it slower."""


def fast_precision(accelerator: str, backbone: str | None) -> str:
    """`MIXED` where that is faster on the device that Lightning would take, else `SINGLE`.

    Where a processor has no instructions for bfloat16, each product in it takes several times as long as in
    single precision.

    Args:
        accelerator: Lightning's name of the kind of device: `auto`, `cpu`, `gpu`, `cuda`, `mps` or `tpu`.
        backbone: Name of the backbone, as for `build_backbone`; None for a network without one.
    """
    import torch

    if accelerator in ("auto", "gpu", "cuda") and torch.cuda.is_available():
        return MIXED if torch.cuda.is_bf16_supported(including_emulation=False) else SINGLE
    if accelerator not in ("auto", "cpu") or not _FAST.fullmatch(backbone or ""):
        return SINGLE
    return MIXED if computes_in_bfloat16() else SINGLE


def computes_in_bfloat16() -> bool:
    """True if the processor has instructions for products in bfloat16."""
    import torch

    has = torch.cpu.get_capabilities()
    return bool(has.get("avx512_bf16") or has.get("amx_bf16"))


def fused_step(precision: str | int | None) -> bool | None:
    """True for a fused step of the optimizer in single precision, else None for PyTorch's own choice.

    Lightning cannot clip gradients for a fused optimizer in mixed precision. False would ask for the slowest
    of PyTorch's steps, which goes from weight to weight.

    Args:
        precision: `trainer.precision`, by any of Lightning's names.
    """
    return True if str(precision) in (SINGLE, "32", "None") else None
