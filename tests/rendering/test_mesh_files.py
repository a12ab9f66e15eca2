"""Mesh files, read back by an independent reader, hold the hands that were written."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from hand_recon.rendering.mesh import vertex_normals
from hand_recon.rendering.mesh_files import NamedMesh, outward, write_meshes

BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
BOX = trimesh.creation.box(extents=(0.02, 0.05, 0.2))
SUFFIXES = [".obj", ".ply", ".glb"]


def ball(name: str = "right", x: float = 0.1) -> NamedMesh:
    return NamedMesh(
        name, np.asarray(BALL.vertices) + np.array([x, 0.02, 0.6]), np.asarray(BALL.faces)
    )


def box(name: str = "left") -> NamedMesh:
    return NamedMesh(
        name, np.asarray(BOX.vertices) + np.array([-0.1, -0.02, 0.5]), np.asarray(BOX.faces)
    )


def read(path: Path) -> Any:  # noqa: ANN401  # its types differ between versions
    """All objects of a file in one mesh, as trimesh reads them, in the camera's frame."""
    mesh: Any = trimesh.load(path, force="mesh", process=False)
    if path.suffix == ".glb":
        mesh.apply_transform(np.diag([1.0, -1.0, -1.0, 1.0]))
    return mesh


def farthest(points: np.ndarray, others: np.ndarray) -> float:
    """Largest distance of a point to the nearest of the others."""
    return float(cKDTree(others).query(points)[0].max())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_two_hands_come_back_with_their_surface_in_metres(tmp_path: Path, suffix: str) -> None:
    path = write_meshes(tmp_path / f"hands{suffix}", [ball(), box()])
    found = read(path)
    expected = np.concatenate([ball().vertices, box().vertices])
    assert farthest(found.vertices, expected) < 1e-6
    assert farthest(expected, found.vertices) < 1e-6
    assert len(found.faces) == len(BALL.faces) + len(BOX.faces)
    assert abs(found.volume - (BALL.volume + 0.02 * 0.05 * 0.2)) < 1e-8


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("reverse", [False, True])
def test_normals_point_outwards_for_either_winding(
    tmp_path: Path, suffix: str, reverse: bool
) -> None:
    mesh = ball()
    faces = mesh.faces[:, ::-1] if reverse else mesh.faces
    path = write_meshes(tmp_path / f"hand{suffix}", [NamedMesh("hand", mesh.vertices, faces)])
    found = read(path)
    outside = found.vertices - found.vertices.mean(axis=0)
    outside /= np.linalg.norm(outside, axis=1, keepdims=True)
    assert (found.vertex_normals * outside).sum(axis=1).min() > 0.99
    # The volume is by the winding alone.
    assert found.volume > 0


def test_the_mirror_image_is_wound_outwards_too() -> None:
    mesh = box()
    mirrored = mesh.vertices * np.array([-1.0, 1.0, 1.0])
    faces = outward(mirrored, mesh.faces)
    assert (faces == mesh.faces[:, ::-1]).all()
    assert trimesh.Trimesh(mirrored, faces, process=False).volume > 0
    assert outward(mesh.vertices, mesh.faces) is mesh.faces


def test_a_hole_does_not_change_the_winding() -> None:
    kept = np.asarray(BALL.faces)[np.asarray(BALL.triangles_center)[:, 2] < 0.03]
    assert len(kept) < len(BALL.faces)
    assert outward(np.asarray(BALL.vertices), kept) is kept


@pytest.mark.parametrize("suffix", [".obj", ".glb"])
def test_every_hand_is_an_object_with_its_name(tmp_path: Path, suffix: str) -> None:
    meshes = [ball("1 right"), box("1 right"), box("Hände\n手"), ball("")]
    path = write_meshes(tmp_path / f"hands{suffix}", meshes)
    if suffix == ".obj":
        names = [line[2:] for line in path.read_text("utf-8").splitlines() if line.startswith("o ")]
    else:
        names = [mesh["name"] for mesh in gltf(path)["meshes"]]
    assert names == ["1 right", "1 right 2", "Hände 手", "hand"]


def gltf(path: Path) -> Any:  # noqa: ANN401
    """The JSON part of a GLB file, read by its own specification."""
    content = path.read_bytes()
    magic, version, length = struct.unpack("<4sII", content[:12])
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack("<I4s", content[12:20])
    assert kind == b"JSON"
    return json.loads(content[20 : 20 + size])


def test_in_gltf_up_is_y_and_the_camera_looks_along_minus_z(tmp_path: Path) -> None:
    # Right, above (y is down in the camera's frame) and in front of the camera.
    mesh = NamedMesh(
        "hand", np.asarray(BALL.vertices) + np.array([0.3, -0.2, 0.6]), np.asarray(BALL.faces)
    )
    found: Any = trimesh.load(write_meshes(tmp_path / "hand.glb", [mesh]), force="mesh")
    assert np.allclose(found.vertices.mean(axis=0), [0.3, 0.2, -0.6], atol=1e-6)


def test_gltf_holds_normals_of_length_one_and_the_colour(tmp_path: Path) -> None:
    mesh = NamedMesh("hand", ball().vertices, ball().faces, colour=(255.0, 0.0, 51.0))
    path = write_meshes(tmp_path / "hand.glb", [mesh])
    parts = gltf(path)
    assert "NORMAL" in parts["meshes"][0]["primitives"][0]["attributes"]
    colour = parts["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"]
    assert np.allclose(colour, [1.0, 0.0, 0.2, 1.0], atol=0.01)


def test_the_written_normals_of_an_obj_are_the_meshs(tmp_path: Path) -> None:
    path = write_meshes(tmp_path / "hand.obj", [ball(), box()])
    lines = [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("vn ")]
    expected = np.concatenate(
        [vertex_normals(mesh.vertices, mesh.faces) for mesh in (ball(), box())]
    )
    assert np.allclose(np.array(lines, dtype=float), expected, atol=1e-4)


def test_the_suffix_is_read_in_either_case_and_folders_are_made(tmp_path: Path) -> None:
    path = write_meshes(tmp_path / "new" / "Hände" / "hand.PLY", [ball()])
    assert path.read_bytes().startswith(b"ply")


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"suffix '\.stl'; expected one of \.obj, \.ply, \.glb"):
        write_meshes(tmp_path / "hand.stl", [ball()])
    with pytest.raises(ValueError, match="Found no hand"):
        write_meshes(tmp_path / "hand.obj", [])
    lost = NamedMesh("3 left", np.full((4, 3), np.nan), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="3 left are not finite"):
        write_meshes(tmp_path / "hand.obj", [ball(), lost])
    assert not list(tmp_path.iterdir())
