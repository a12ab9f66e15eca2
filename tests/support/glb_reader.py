"""Reader of skinned, animated GLB files, written from the glTF 2.0 specification alone."""

import json
import struct
from typing import Any

import numpy as np
from jaxtyping import Float

_COMPONENTS = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class GlbReader:
    """A GLB file with the first of its animations."""

    def __init__(self, content: bytes) -> None:
        magic, version, length = struct.unpack("<4sII", content[:12])
        assert (magic, version, length) == (b"glTF", 2, len(content))
        chunks, position = [], 12
        while position < length:
            size, kind = struct.unpack("<I4s", content[position : position + 8])
            assert size % 4 == 0
            chunks.append((kind, content[position + 8 : position + 8 + size]))
            position += 8 + size
        assert [kind for kind, _ in chunks] == [b"JSON", b"BIN\0"]
        self.document: dict[str, Any] = json.loads(chunks[0][1])
        self.binary = chunks[1][1]
        assert self.document["buffers"] == [{"byteLength": len(self.binary)}]
        self.nodes: list[dict[str, Any]] = self.document["nodes"]
        self.parents = {
            child: node
            for node, entry in enumerate(self.nodes)
            for child in entry.get("children", ())
        }

    def array(self, accessor: int) -> Float[np.ndarray, "element component"]:
        """Values of an accessor, a row per element."""
        entry = self.document["accessors"][accessor]
        view = self.document["bufferViews"][entry["bufferView"]]
        count = entry["count"] * _WIDTHS[entry["type"]]
        begin = view["byteOffset"] + entry.get("byteOffset", 0)
        values = np.frombuffer(self.binary, _COMPONENTS[entry["componentType"]], count, begin)
        assert values.nbytes <= view["byteLength"]
        return values.reshape(entry["count"], -1).astype(np.float64)

    def attribute(self, name: str, attribute: str) -> Float[np.ndarray, "vertex component"]:
        """Attribute of the mesh of a node."""
        return self.array(self.primitive(name)["attributes"][attribute])

    def primitive(self, name: str) -> dict[str, Any]:
        """The single primitive of the mesh of a node."""
        (primitive,) = self.document["meshes"][self.nodes[self.named(name)]["mesh"]]["primitives"]
        result: dict[str, Any] = primitive
        return result

    def named(self, name: str) -> int:
        """Index of the node of a name, which no other has."""
        (index,) = [index for index, node in enumerate(self.nodes) if node["name"] == name]
        return index

    def channels(self, node: int) -> dict[str, dict[str, Any]]:
        """Samplers of a node by the property that they animate."""
        (animation,) = self.document["animations"]
        return {
            channel["target"]["path"]: animation["samplers"][channel["sampler"]]
            for channel in animation["channels"]
            if channel["target"]["node"] == node
        }

    def posed(self, name: str, time: float) -> Float[np.ndarray, "vertex 3"]:
        """Vertices of a skinned node in the scene at a time, by linear blend skinning."""
        skin = self.document["skins"][self.nodes[self.named(name)]["skin"]]
        inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2)
        matrices = np.stack([self._placed(node, time) for node in skin["joints"]]) @ inverse
        points = self.attribute(name, "POSITION")
        points = np.concatenate([points, np.ones((len(points), 1))], axis=1)
        joints = self.attribute(name, "JOINTS_0").astype(int)
        weights = self.attribute(name, "WEIGHTS_0")
        moved = np.einsum("vi,vixy,vy->vx", weights, matrices[joints], points)
        return moved[:, :3]

    def _placed(self, node: int, time: float) -> Float[np.ndarray, "4 4"]:
        """Matrix from a node's frame to the scene's."""
        entry, channels = self.nodes[node], self.channels(node)
        rest = {
            "translation": entry.get("translation", [0.0, 0, 0]),
            "rotation": entry.get("rotation", [0.0, 0, 0, 1]),
            "scale": entry.get("scale", [1.0, 1, 1]),
        }
        value = {
            path: self._sampled(channels[path], path, time)
            if path in channels
            else np.array(default)
            for path, default in rest.items()
        }
        matrix = np.eye(4)
        matrix[:3, :3] = _rotation(value["rotation"]) * value["scale"]
        matrix[:3, 3] = value["translation"]
        return self._placed(self.parents[node], time) @ matrix if node in self.parents else matrix

    def _sampled(self, sampler: dict[str, Any], path: str, time: float) -> np.ndarray:
        times, values = self.array(sampler["input"])[:, 0], self.array(sampler["output"])
        after = int(np.searchsorted(times, time, side="right"))
        if after in (0, len(times)):
            return values[min(after, len(times) - 1)]
        before, following = values[after - 1], values[after]
        if sampler["interpolation"] == "STEP":
            return before
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        if path != "rotation":
            return before + share * (following - before)
        # Not the shorter way of the two: a file must not need that.
        angle = np.arccos(np.clip(before @ following, -1.0, 1.0))
        if angle < 1e-6:
            return following
        mixed: np.ndarray = (
            np.sin((1 - share) * angle) * before + np.sin(share * angle) * following
        ) / np.sin(angle)
        return mixed


def _rotation(quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
