"""Nearest point of a triangle, for the depth of a vertex (Sec. 3.2, d(v) of Eq. 4)."""

import torch
from jaxtyping import Float
from torch import Tensor


def nearest_on_triangles(
    points: Float[Tensor, "*pair 3"], triangles: Float[Tensor, "*pair corner=3 3"]
) -> Float[Tensor, "*pair corner=3"]:
    """Barycentric coordinates of each triangle's nearest point to the point it is paired with.

    The nearest point is the foot of the perpendicular if that lies in the triangle, and otherwise the nearest
    of three points, one on each side. A triangle without area has only its sides.

    Args:
        points: One point per pair, metres.
        triangles: One triangle per pair, metres.
    """
    origin, second, third = triangles.unbind(dim=-2)
    along, across, towards = second - origin, third - origin, points - origin
    squared_along, squared_across, skew = (
        _dot(along, along),
        _dot(across, across),
        _dot(along, across),
    )
    on_along, on_across = _dot(along, towards), _dot(across, towards)
    area = squared_along * squared_across - skew.square()

    def share(part: Tensor, whole: Tensor) -> Tensor:
        return (part / whole.clamp(min=torch.finfo(whole.dtype).tiny)).clamp(0, 1)

    opposite = share(
        squared_along - on_along - skew + on_across, squared_along + squared_across - 2 * skew
    )
    zero = torch.zeros_like(area)
    foot_area = area.clamp(min=torch.finfo(area.dtype).tiny)
    # Each candidate is a share of the first side from the origin plus a share of the second.
    first = torch.stack(
        [share(on_along, squared_along), zero, 1 - opposite,
         (squared_across * on_along - skew * on_across) / foot_area]
    )  # fmt: skip
    last = torch.stack(
        [zero, share(on_across, squared_across), opposite,
         (squared_along * on_across - skew * on_along) / foot_area]
    )  # fmt: skip
    # The squared distance, up to a constant that all candidates share.
    height = first * (first * squared_along + 2 * last * skew - 2 * on_along)
    height += last * (last * squared_across - 2 * on_across)
    beside = (first[3] < 0) | (last[3] < 0) | (first[3] + last[3] > 1) | (area <= 0)
    height[3].masked_fill_(beside, torch.inf)
    best = height.argmin(dim=0, keepdim=True)
    first, last = first.gather(0, best)[0], last.gather(0, best)[0]
    return torch.stack([1 - first - last, first, last], dim=-1)


def _dot(
    first: Float[Tensor, "*pair 3"], second: Float[Tensor, "*pair 3"]
) -> Float[Tensor, "*pair"]:
    return (first * second).sum(dim=-1)
