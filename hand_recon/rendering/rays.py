"""Ray casting with embree: what a pixel sees, what a light reaches, which joints are hidden."""

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True)
class Hits:
    """The nearest surface along the rays that meet one."""

    ray: Int[np.ndarray, " hit"]
    """Which ray."""
    face: Int[np.ndarray, " hit"]
    """Which triangle."""
    weights: Float[np.ndarray, "hit 3"]
    """Barycentric coordinates in it."""
    distance: Float[np.ndarray, " hit"]
    """Along the ray, in lengths of its direction."""


class RayScene:
    """Triangles ready for rays."""

    def __init__(
        self, vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
    ) -> None:
        """Build the tree.

        Args:
            vertices: Metres.
            faces: Their triangles.
        """
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, vertices.astype(np.float32), faces.astype(np.int32))

    def nearest(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Hits:
        """What each ray meets first; rays that meet nothing are left out."""
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
        """Whether a ray meets anything within a distance.

        Args:
            origins: Metres.
            directions: Of unit length.
            reach: Metres.
        """
        found = self._scene.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            dists=np.full(len(origins), reach, dtype=np.float32),
            query="OCCLUDED",
        )
        return np.asarray(found >= 0)
