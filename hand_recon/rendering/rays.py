"""Ray casting with Embree, for rendering, shadows and occlusion of landmarks."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True)
class Hits:
    """Nearest intersections of rays with triangles; rays without one are left out."""

    ray: Int[np.ndarray, " hit"]
    """Index of the ray."""
    face: Int[np.ndarray, " hit"]
    """Index of the triangle."""
    weights: Float[np.ndarray, "hit 3"]
    """Barycentric coordinates in the triangle."""
    distance: Float[np.ndarray, " hit"]
    """Distance along the ray, in multiples of its direction's length."""


@cache
def _device() -> EmbreeDevice:
    """Embree's device, one for all scenes of a process."""
    return EmbreeDevice()


class RayScene:
    """Triangles in a structure for fast ray casting."""

    def __init__(
        self, vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
    ) -> None:
        """Build the bounding volume hierarchy.

        Args:
            vertices: Vertices, metres.
            faces: Triangles.
        """
        self._scene = EmbreeScene(_device())
        self._mesh = TriangleMesh(self._scene, vertices.astype(np.float32), faces.astype(np.int32))

    def nearest(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Hits:
        """First intersection of each ray; rays without one are left out."""
        found = self._scene.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            output=1,
        )
        ray = np.flatnonzero(found["primID"] >= 0)
        u, v = found["u"][ray], found["v"][ray]
        return Hits(
            ray, found["primID"][ray], np.stack([1 - u - v, u, v], axis=1), found["tfar"][ray]
        )

    def blocked(
        self,
        origins: Float[np.ndarray, "ray 3"],
        directions: Float[np.ndarray, "ray 3"],
        reach: float = 10.0,
    ) -> Bool[np.ndarray, " ray"]:
        """Test each ray for any intersection within a distance.

        Args:
            origins: Starting points, metres.
            directions: Unit vectors.
            reach: Largest distance, metres.
        """
        found = self._scene.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            dists=np.full(len(origins), reach, dtype=np.float32),
            query="OCCLUDED",
        )
        return np.asarray(found >= 0)
