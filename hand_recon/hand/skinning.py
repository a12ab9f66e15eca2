"""Blend shapes and linear blend skinning of the surface, in the memory order that is fastest (Sec. 3.1).

Vertices are the last axis, so that a blend is one matrix product and a rotation is sums of long rows. On a
processor a few hands at a time go through both, since what lies between then stays in the cache.
"""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor, nn

HANDS_AT_ONCE: Final = 16
"""Hands whose blended motions fit in a core's cache: 0.6 MB for MANO's 778 vertices."""
_COMPILED_LOTS: Final = 8
"""Most lots of hands that are written out in a compiled layer."""


class LinearBlendSkinning(nn.Module):
    """Surface of a hand from the coefficients of its blend shapes and the motions of its joints."""

    mean: Tensor
    directions: Tensor
    weights: Tensor

    def __init__(
        self,
        template: Float[Tensor, "vertex 3"],
        directions: list[Float[Tensor, "vertex 3 _"]],
        weights: Float[Tensor, "vertex joint=16"],
    ) -> None:
        """Rearrange a hand's arrays.

        Args:
            template: Mean surface, metres.
            directions: Displacements per unit of each coefficient, metres; shape first.
            weights: Weight of each joint's motion at each vertex.
        """
        super().__init__()
        joined = torch.cat(directions, dim=-1)
        self.vertices = len(template)
        for name, tensor in (
            ("mean", template.mT.flatten()),
            ("directions", joined.permute(2, 1, 0).flatten(1)),
            ("weights", weights.mT),
        ):
            self.register_buffer(name, tensor.contiguous(), persistent=False)

    def forward(
        self,
        coefficients: Float[Tensor, "hand coefficient"],
        rotations: Float[Tensor, "hand joint=16 3 3"],
        translations: Float[Tensor, "hand joint=16 3"],
    ) -> Float[Tensor, "hand 3 vertex"]:
        """Move every vertex by the weighted mean of the joints' rigid motions.

        Args:
            coefficients: Coefficients of the blend shapes.
            rotations: Rotation of each joint's motion.
            translations: Translation of each joint's motion, metres.
        """
        motions = torch.cat([rotations, translations[..., None]], dim=-1).permute(0, 2, 3, 1)
        if coefficients.device.type != "cpu" or torch.compiler.is_exporting():
            return self._moved(coefficients, motions)
        count = HANDS_AT_ONCE
        if torch.compiler.is_compiling():
            count = max(count, -(-len(coefficients) // _COMPILED_LOTS))
        lots = zip(coefficients.split(count), motions.split(count), strict=True)
        moved = [self._moved(*lot) for lot in lots]
        return moved[0] if len(moved) == 1 else torch.cat(moved)

    def _moved(
        self,
        coefficients: Float[Tensor, "hand coefficient"],
        motions: Float[Tensor, "hand 3 column=4 joint=16"],
    ) -> Float[Tensor, "hand 3 vertex"]:
        hands = coefficients.shape[0]
        surface = torch.addmm(self.mean, coefficients, self.directions)
        x, y, z = surface.view(hands, 1, 3, self.vertices).unbind(dim=2)
        blended = motions.reshape(12 * hands, motions.shape[-1]) @ self.weights
        columns = blended.view(hands, 3, 4, self.vertices).unbind(dim=2)
        moved = torch.addcmul(columns[3], columns[0], x)
        return torch.addcmul(torch.addcmul(moved, columns[1], y), columns[2], z)
