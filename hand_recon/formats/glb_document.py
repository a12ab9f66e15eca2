"""Container of a GLB file: the JSON of a glTF 2.0 document and the binary arrays that it points to."""

import json
import struct
from typing import Any, Final, Literal

import numpy as np
from jaxtyping import Shaped

_COMPONENTS: Final = {"float32": 5126, "uint8": 5121, "uint16": 5123, "uint32": 5125}
_TYPES: Final[dict[tuple[int, ...], str]] = {
    (): "SCALAR",
    (3,): "VEC3",
    (4,): "VEC4",
    (4, 4): "MAT4",
}
_TARGETS: Final = {"vertices": 34962, "triangles": 34963}

_MAGIC: Final = 0x46546C67
_JSON: Final = 0x4E4F534A
_BINARY: Final = 0x004E4942


class GlbDocument:
    """A glTF document under construction, with one scene and one buffer."""

    def __init__(self) -> None:
        self._lists: dict[str, list[dict[str, Any]]] = {}
        self._roots: list[int] = []
        self._binary = bytearray()

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Append an object to one of the document's lists.

        Args:
            kind: Name of the list, such as `nodes` or `meshes`.
            entry: The object.

        Returns:
            Index of the object in its list.
        """
        entries = self._lists.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def count(self, kind: str) -> int:
        """Length of one of the document's lists."""
        return len(self._lists.get(kind, []))

    def add_to_scene(self, *nodes: int) -> None:
        """Put nodes at the root of the scene."""
        self._roots += nodes

    def accessor(
        self,
        values: Shaped[np.ndarray, "element ..."],
        *,
        target: Literal["vertices", "triangles"] | None = None,
        bounds: bool = False,
    ) -> int:
        """Append an array to the buffer.

        Args:
            values: Scalars, vectors or 4 × 4 matrices (transposed here: glTF's run by columns), of a type
                that glTF has.
            target: Use by a GPU.
            bounds: Whether the smallest and largest value of each component are written, too.

        Returns:
            Index of the accessor.
        """
        if values.ndim == 3:
            values = values.swapaxes(1, 2)
        self._pad()
        view = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": values.nbytes}
        if target is not None:
            view["target"] = _TARGETS[target]
        order = values.dtype.newbyteorder("<")
        self._binary += np.ascontiguousarray(values, dtype=order).tobytes()
        entry: dict[str, Any] = {
            "bufferView": self.add("bufferViews", view),
            "componentType": _COMPONENTS[values.dtype.name],
            "count": len(values),
            "type": _TYPES[values.shape[1:]],
        }
        if bounds:
            rows = values.reshape(len(values), -1)
            entry |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self.add("accessors", entry)

    def to_bytes(self) -> bytes:
        """Bytes of the GLB file."""
        self._pad()
        document = {
            "asset": {"version": "2.0", "generator": "hand_recon"},
            "scene": 0,
            "scenes": [{"nodes": self._roots}],
            "buffers": [{"byteLength": len(self._binary)}],
            **self._lists,
        }
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), _JSON) + text
        chunks += struct.pack("<II", len(self._binary), _BINARY) + bytes(self._binary)
        return struct.pack("<III", _MAGIC, 2, 12 + len(chunks)) + chunks

    def _pad(self) -> None:
        """Fill the buffer to a multiple of four bytes, at which every array and chunk begins."""
        self._binary += bytes(-len(self._binary) % 4)
