"""Hands of a USD stage: joints by USD's own code, and the surface by linear blend skinning written here."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float


class UsdHands:
    """A stage of skinned hands, read again from its file."""

    def __init__(self, path: Path) -> None:
        # Here, since this module is read where the extra is not installed, too.
        from pxr import Usd, UsdGeom, UsdSkel

        self.geometry, self.skeletons = UsdGeom, UsdSkel
        self.everything = Usd.PrimDefaultPredicate
        self.stage = Usd.Stage.Open(str(path))
        self.cache = UsdSkel.Cache()
        self.names = [prim.GetName() for prim in self.stage.GetDefaultPrim().GetChildren()]

    def code(self, seconds: float) -> float:
        """Time code of a time."""
        return float(seconds * self.stage.GetTimeCodesPerSecond())

    def joints(self, name: str, seconds: float) -> Float[np.ndarray, "joint=16 3"]:
        """Positions of the joints in the stage, by USD."""
        placed = self._matrices(name, seconds)
        return np.array([matrix.ExtractTranslation() for matrix in placed])

    def vertices(self, name: str, seconds: float) -> Float[np.ndarray, "vertex 3"]:
        """Posed surface, skinned here."""
        prim = self.stage.GetPrimAtPath(f"/hands/{name}/skin")
        points = np.array(self.geometry.Mesh(prim).GetPointsAttr().Get(), dtype=np.float64)
        binding = self.skeletons.BindingAPI(prim)
        influences = binding.GetJointIndicesPrimvar()
        width = influences.GetElementSize()
        chosen = np.array(influences.Get()).reshape(-1, width)
        weights = np.array(binding.GetJointWeightsPrimvar().Get()).reshape(-1, width)
        bind = self._skeleton(name).GetBindTransformsAttr().Get()
        moves = np.array(
            [
                np.array(start.GetInverse() * end)
                for start, end in zip(bind, self._matrices(name, seconds), strict=True)
            ]
        )
        homogeneous = np.concatenate([points, np.ones((len(points), 1))], axis=1)
        # USD's vectors are rows.
        moved = np.einsum("vi,vx,vixy->vy", weights, homogeneous, moves[chosen])
        return np.asarray(moved[:, :3])

    def own_vertices(self, name: str, seconds: float) -> Float[np.ndarray, "vertex 3"]:
        """Posed surface, skinned by USD."""
        prim = self.stage.GetPrimAtPath(f"/hands/{name}/skin")
        root = self.skeletons.Root(self.stage.GetPrimAtPath(f"/hands/{name}"))
        self.cache.Populate(root, self.everything)
        query = self.cache.GetSkinningQuery(prim)
        code = self.code(seconds)
        transforms = self.cache.GetSkelQuery(self._skeleton(name)).ComputeSkinningTransforms(code)
        points = self.geometry.Mesh(prim).GetPointsAttr().Get()
        assert query.ComputeSkinnedPoints(transforms, points, code)
        return np.array(points, dtype=np.float64)

    def is_visible(self, name: str, seconds: float) -> bool:
        """True where the hand is shown."""
        shape = self.geometry.Imageable(self.stage.GetPrimAtPath(f"/hands/{name}"))
        return bool(shape.ComputeVisibility(self.code(seconds)) == self.geometry.Tokens.inherited)

    def _skeleton(self, name: str) -> Any:  # noqa: ANN401  # pxr has no types
        return self.skeletons.Skeleton(self.stage.GetPrimAtPath(f"/hands/{name}/skeleton"))

    def _matrices(self, name: str, seconds: float) -> list[Any]:
        root = self.skeletons.Root(self.stage.GetPrimAtPath(f"/hands/{name}"))
        self.cache.Populate(root, self.everything)
        query = self.cache.GetSkelQuery(self._skeleton(name))
        return list(query.ComputeJointSkelTransforms(self.code(seconds)))
