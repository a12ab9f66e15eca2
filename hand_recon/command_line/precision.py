"""Precision in which a machine trains a network for images fastest (decision 101)."""

from typing import Final

import torch

SINGLE: Final = "32-true"
"""Lightning's name of single precision."""

MIXED: Final = "bf16-mixed"
"""Lightning's name of convolutions and products in bfloat16 with weights in single precision."""


def fast_precision(accelerator: str = "auto") -> str:
    """`MIXED` where the device that Lightning would take computes in bfloat16, else `SINGLE`.

    Where a processor has no instructions for bfloat16, each product in it takes several times as long as in
    single precision.

    Args:
        accelerator: Lightning's name of the kind of device: `auto`, `cpu`, `gpu`, `cuda`, `mps` or `tpu`.
    """
    if accelerator in ("auto", "gpu", "cuda") and torch.cuda.is_available():
        return MIXED if torch.cuda.is_bf16_supported(including_emulation=False) else SINGLE
    if accelerator not in ("auto", "cpu"):
        return SINGLE
    has = torch.cpu.get_capabilities()
    return MIXED if has.get("avx512_bf16") or has.get("amx_bf16") else SINGLE
