"""Vectors and colours as planes: arrays whose first axis is x, y and z, or red, green and blue.

NumPy works on an array's rows one after another: with the points or pixels of an image in the rows, rather
than three coordinates, the same operations take a fifth of the time or less, with equal results to the bit.
"""

import numpy as np
from jaxtyping import Float

Planes = Float[np.ndarray, "3 ..."]


def cross(first: Planes, second: Planes) -> Planes:
    """Cross product of vectors, whose other axes are broadcast."""
    (x, y, z), (u, v, w) = first, second
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def length(vectors: Planes) -> Float[np.ndarray, "..."]:
    """Euclidean length of vectors."""
    squared = vectors * vectors
    return np.asarray(np.sqrt(squared[0] + squared[1] + squared[2]))


def mixed(
    first: Float[np.ndarray, " 3"],
    second: Float[np.ndarray, " 3"],
    share: Float[np.ndarray, "..."],
) -> Planes:
    """Mixture of two colours.

    Args:
        first: Colour where the share is 0.
        second: Colour where the share is 1.
        share: Share of the second colour at each point.
    """
    column = (3,) + (1,) * share.ndim
    return np.asarray(first.reshape(column) * (1 - share) + second.reshape(column) * share)
