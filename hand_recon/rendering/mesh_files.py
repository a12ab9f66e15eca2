"""Hands as mesh files for other programs: OBJ, PLY and GLB, with vertex normals, in metres.

OBJ and PLY keep the camera's frame: x to the right, y down, z along the viewing direction. GLB is in glTF's
frame, x to the right, y up and the viewing direction along −z, so that a viewer shows the hand as the camera
saw it: y and z change their signs, which is a rotation and leaves a right hand a right hand.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int

from hand_recon.rendering.mesh import BLUE, vertex_normals

MESH_SUFFIXES: Final = (".obj", ".ply", ".glb")
"""Suffixes of the formats that `write_meshes` writes."""

CAMERA_TO_GLTF: Final = (1.0, -1.0, -1.0)
"""Factors of x, y and z from the camera's frame to glTF's, and back."""


@dataclass(frozen=True)
class NamedMesh:
    """One hand for a mesh file."""

    name: str
    """Name of the object in the file; a repeated name gets a number."""
    vertices: Float[np.ndarray, "vertex 3"]
    """Camera frame, metres; left hands are left hands."""
    faces: Int[np.ndarray, "face 3"]
    """Triangles, in either winding: they are written so that the outside is their front."""
    colour: tuple[float, float, float] = BLUE
    """RGB, 0–255."""


def write_meshes(path: str | Path, meshes: Sequence[NamedMesh]) -> Path:
    """Write one or several hands to a file whose suffix says the format: .obj, .ply or .glb.

    OBJ has an object per hand, GLB a node per hand with its colour; PLY joins all hands, with colours of
    vertices, because the format has no objects. Folders are made.

    Args:
        path: File to write; an existing one is replaced.
        meshes: Hands in one camera's frame.

    Raises:
        ValueError: The suffix is none of these, there is no hand, or vertices are not finite.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise ValueError(
            f"{path.name} has the suffix '{path.suffix}'; expected one of {', '.join(MESH_SUFFIXES)}. Rename "
            "the file."
        )
    _check(meshes)
    path.parent.mkdir(parents=True, exist_ok=True)
    named = _with_distinct_names(meshes)
    if suffix == ".obj":
        path.write_text(_obj(named), encoding="utf-8")
    else:
        path.write_bytes(_ply(named) if suffix == ".ply" else _glb(named))
    return path


def outward(
    vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
) -> Int[np.ndarray, "face 3"]:
    """Triangles wound anticlockwise seen from outside, whichever way they were wound.

    The mirror image of a mesh has its triangles the other way round. The winding is judged by the enclosed
    volume, which is positive for outward triangles; a hole such as the wrist's changes it little.

    Args:
        vertices: Vertices, any unit.
        faces: Triangles, all wound alike.
    """
    corners = (vertices - vertices.mean(axis=0))[faces]
    volume = np.einsum("fx,fx->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return faces if volume >= 0 else np.ascontiguousarray(faces[:, ::-1])


def _check(meshes: Sequence[NamedMesh]) -> None:
    if not meshes:
        raise ValueError("Found no hand to write; expected one or more. Leave the file out.")
    unknown = [mesh.name for mesh in meshes if not np.isfinite(mesh.vertices).all()]
    if unknown:
        raise ValueError(
            f"The vertices of {', '.join(unknown)} are not finite; expected metres. Leave out hands without "
            "a result."
        )


def _with_distinct_names(meshes: Sequence[NamedMesh]) -> list[NamedMesh]:
    taken: set[str] = set()
    named = []
    for mesh in meshes:
        # Names of objects end at a line's end.
        stem = " ".join(mesh.name.split()).encode("utf-8", "backslashreplace").decode() or "hand"
        name, number = stem, 2
        while name in taken:
            name, number = f"{stem} {number}", number + 1
        taken.add(name)
        faces = outward(mesh.vertices, mesh.faces)
        named.append(NamedMesh(name, mesh.vertices, faces, mesh.colour))
    return named


def _obj(meshes: Sequence[NamedMesh]) -> str:
    """Wavefront OBJ; written here since trimesh shares no normals between several objects."""
    lines = ["# Metres, camera frame: x right, y down, z forward."]
    first = 1
    for mesh in meshes:
        lines.append(f"o {mesh.name}")
        lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices.tolist()]
        normals = vertex_normals(mesh.vertices, mesh.faces)
        lines += [f"vn {x:.4f} {y:.4f} {z:.4f}" for x, y, z in normals.tolist()]
        lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in (mesh.faces + first).tolist()]
        first += len(mesh.vertices)
    return "\n".join(lines) + "\n"


def _ply(meshes: Sequence[NamedMesh]) -> bytes:
    # Half a second, which commands that write no such file should not wait for.
    import trimesh

    joined = trimesh.util.concatenate([_trimesh(mesh, np.ones(3)) for mesh in meshes])
    written = trimesh.exchange.ply.export_ply(joined, vertex_normal=True)
    return bytes(written)


def _glb(meshes: Sequence[NamedMesh]) -> bytes:
    import trimesh

    scene = trimesh.Scene()
    for mesh in meshes:
        shape = _trimesh(mesh, np.array(CAMERA_TO_GLTF))
        material = trimesh.visual.material.PBRMaterial(  # type: ignore[no-untyped-call]
            name=mesh.name, baseColorFactor=[round(value) for value in mesh.colour] + [255],
            metallicFactor=0.0, roughnessFactor=0.7, doubleSided=True,
        )  # fmt: skip
        shape.visual = trimesh.visual.TextureVisuals(material=material)  # type: ignore[no-untyped-call]
        scene.add_geometry(shape, node_name=mesh.name, geom_name=mesh.name)
    written = trimesh.exchange.gltf.export_glb(scene, include_normals=True)  # type: ignore[no-untyped-call]
    return bytes(written)


def _trimesh(mesh: NamedMesh, factors: Float[np.ndarray, "3"]) -> Any:  # noqa: ANN401  # trimesh is imported late
    import trimesh

    vertices = mesh.vertices * factors
    return trimesh.Trimesh(
        vertices, mesh.faces, vertex_normals=vertex_normals(vertices, mesh.faces), process=False,
        vertex_colors=[round(value) for value in mesh.colour] + [255],
    )  # fmt: skip
