"""Landmarks as the mean positions of maps over the crop (integral regression; Sun et al., ECCV 2018)."""

from collections.abc import Mapping
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from hand_recon.regressor.depthwise import DepthwiseConv2d

STRIDES: Final = (32, 16, 8)
"""Strides of the features that are joined, coarse to fine."""

REACH: Final = 1.25
"""Side of the square that positions span, in sides of the crop: landmarks may lie outside of the crop."""


class LandmarkMaps(nn.Module):
    """Finds 21 landmarks in features of several strides.

    Coarse features are enlarged and added to finer ones; the finest give one map per landmark. A position
    is the mean of the cells' centres under the softmax of the map, so that it is not bound to the cells.

    Args:
        channels: Channels of the features by stride.
        width: Channels of the joined features.
    """

    def __init__(self, channels: Mapping[int, int], width: int = 96) -> None:
        super().__init__()
        self.lateral = nn.ModuleDict(
            {str(stride): nn.Conv2d(channels[stride], width, 1) for stride in STRIDES}
        )
        self.smooth = nn.ModuleDict(
            {
                str(stride): nn.Sequential(
                    DepthwiseConv2d(width, 5),
                    nn.Conv2d(width, width, 1, bias=False),
                    nn.BatchNorm2d(width),
                    nn.ReLU(),
                )
                for stride in STRIDES
            }
        )
        # Four maps per landmark and cell: the maps have twice the resolution of the finest features.
        self.maps = nn.Sequential(nn.Conv2d(width, 21 * 4, 1), nn.PixelShuffle(2))

    def forward(
        self, features: Mapping[int, Float[Tensor, "batch channel row column"]]
    ) -> tuple[Float[Tensor, "batch landmark=21 2"], Float[Tensor, "batch landmark=21"]]:
        """Positions and their spread.

        Args:
            features: Features by stride.

        Returns:
            Positions, 0–1 over the crop from its upper left corner, and the standard deviation of each
            map in the same unit, over both axes.
        """
        joined = None
        for stride in STRIDES:
            here = self.lateral[str(stride)](features[stride])
            if joined is not None:
                here = here + functional.interpolate(joined, here.shape[-2:], mode="nearest")
            joined = self.smooth[str(stride)](here)
        assert joined is not None  # noqa: S101
        return mean_positions(self.maps(joined).float())


def mean_positions(
    maps: Float[Tensor, "batch landmark row column"],
) -> tuple[Float[Tensor, "batch landmark 2"], Float[Tensor, "batch landmark"]]:
    """Mean position and standard deviation of the softmax of each map, 0–1 over the crop.

    Args:
        maps: Logits of cells that span `REACH` sides of the crop, centred.
    """
    across, down = (_centres(maps, axis) for axis in (-1, -2))
    shares = maps.flatten(2).softmax(dim=-1).unflatten(2, maps.shape[2:])
    by_column, by_row = shares.sum(dim=-2), shares.sum(dim=-1)
    x, y = (by_column * across).sum(dim=-1), (by_row * down).sum(dim=-1)
    variance = (by_column * (across - x[..., None]).square()).sum(dim=-1)
    variance = variance + (by_row * (down - y[..., None]).square()).sum(dim=-1)
    return torch.stack([x, y], dim=-1), variance.clamp(min=1e-8).sqrt()


def _centres(maps: Tensor, axis: int) -> Float[Tensor, " cell"]:
    cells = maps.shape[axis]
    return 0.5 + REACH * ((torch.arange(cells, device=maps.device) + 0.5) / cells - 0.5)
