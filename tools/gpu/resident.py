"""Crops of hands in the device's memory, decoded once, and batches of them."""

import io
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from PIL import Image
from torch import Tensor
from torch.nn import functional

from gpu.packed import PackedHands
from hand_recon.schema import HandBatch

_AT_ONCE: Final = 512
"""Crops that are decoded and resized at once."""


@dataclass(frozen=True)
class ResidentHands:
    """Crops and labels on one device."""

    images: UInt8[Tensor, "hand 3 size size"]
    """RGB; exactly black outside of the images."""
    landmarks_2d: Float[Tensor, "hand landmark=21 2"]
    """Labels, pixels of these crops; NaN without a label."""
    labelled: Bool[Tensor, "hand landmark=21"]
    """True for landmarks that have a label."""
    names: tuple[str, ...]
    """Name of each hand, for messages."""
    landmarks_3d: Float[Tensor, "hand landmark=21 3"] | None = None
    """Ground truth, camera frame, metres; None without any."""

    def __len__(self) -> int:
        return len(self.names)

    def batch(self, index: Int[Tensor, " batch"]) -> HandBatch:
        """Some of the hands, with images as bytes.

        Args:
            index: Positions, on the CPU, so that nothing waits for the device.
        """
        there = index.to(self.images.device, non_blocking=True)
        in_3d = self.landmarks_3d
        return HandBatch(
            image=self.images[there],
            landmarks_2d=self.landmarks_2d[there],
            labelled=self.labelled[there],
            index=there,
            source=tuple(self.names[place] for place in index.tolist()),
            landmarks_3d=None if in_3d is None else in_3d[there],
        )

    def batches(self, size: int) -> Iterator[HandBatch]:
        """All hands in order, the last batch smaller where it must be."""
        for index in torch.arange(len(self)).split(size):
            yield self.batch(index)

    def followed_by(self, others: "ResidentHands") -> "ResidentHands":
        """These hands, then others, without 3D."""
        return ResidentHands(
            torch.cat([self.images, others.images]),
            torch.cat([self.landmarks_2d, others.landmarks_2d]),
            torch.cat([self.labelled, others.labelled]),
            self.names + others.names,
        )


def load(
    hands: PackedHands, which: Int[np.ndarray, " row"], size: int, device: torch.device
) -> ResidentHands:
    """Decode crops into the device's memory.

    Args:
        hands: Encoded crops.
        which: Rows to decode.
        size: Side of the crops wanted, pixels; stored ones are resized on the device.
        device: Where they are kept.
    """
    images = torch.empty(len(which), 3, size, size, dtype=torch.uint8, device=device)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for start in range(0, len(which), _AT_ONCE):
            rows = which[start : start + _AT_ONCE].tolist()
            # Decoders run outside of the interpreter's lock.
            squares = torch.stack(list(pool.map(partial(_square, hands), rows)))
            images[start : start + len(rows)] = resized(squares.to(device), size)
    landmarks = torch.from_numpy(hands.landmarks_2d[which]).to(device) * (size / hands.size)
    in_3d = hands.landmarks_3d
    return ResidentHands(
        images,
        landmarks,
        landmarks.isfinite().all(dim=-1),
        tuple(hands.names[row] for row in which.tolist()),
        None if in_3d is None else torch.from_numpy(in_3d[which]).float().to(device),
    )


def _square(hands: PackedHands, row: int) -> UInt8[Tensor, "3 size size"]:
    """A whole crop, black outside of its image."""
    part = decode(hands.images[row])
    left, top = hands.corners[row].tolist()
    height, width = part.shape[1:]
    square = torch.zeros(3, hands.size, hands.size, dtype=torch.uint8)
    # Exact black means outside of the image, so that inside of it nothing may be.
    square[:, top : top + height, left : left + width] = part.clamp(min=1)
    return square


def resized(
    images: UInt8[Tensor, "image 3 old old"], size: int
) -> UInt8[Tensor, "image 3 size size"]:
    """Square images of another size, bilinearly, averaged where they shrink.

    Args:
        images: RGB.
        size: New side, pixels.
    """
    if images.shape[-1] == size:
        return images
    shrinks = size < images.shape[-1]
    wanted = (size, size)
    floats = functional.interpolate(images.float(), wanted, mode="bilinear", antialias=shrinks)
    return floats.round_().clamp_(0, 255).to(torch.uint8)


def decode(content: bytes) -> UInt8[Tensor, "3 height width"]:
    """RGB image of an image file's content."""
    with Image.open(io.BytesIO(content)) as image:
        return torch.from_numpy(np.array(image.convert("RGB")).transpose(2, 0, 1).copy())
