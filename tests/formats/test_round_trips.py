"""Formats read back by independent readers have the hands that were written, to a tenth of a millimetre.

`pytest tests/formats/test_round_trips.py --log-cli-level=INFO` shows the largest error of each format, which
docs/export.md has.
"""

import csv
import json
import logging
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from jaxtyping import Float

from hand_recon.formats.by_name import FORMATS, write
from hand_recon.formats.exported_hands import ExportedHand, ExportedHands
from hand_recon.hand.mano.hand import mano_hand
from hand_recon.hand.mano.layer import ManoLayer
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES, JOINTS, LANDMARK_OF_JOINT, LANDMARKS
from tests.support.bvh_reader import BvhReader
from tests.support.exported import clip, expected_joints, photographs
from tests.support.glb_reader import GlbReader
from tests.support.mano_file import write_mano_folder
from tests.support.opensim_reader import read_mot, read_trc
from tests.support.trajectories import TO_GLTF, in_camera

logger = logging.getLogger(__name__)

TENTH_OF_A_MILLIMETRE = 1e-4

Points = Float[np.ndarray, "... 3"]
Pair = tuple[Points, Points]
"""Points that were found, and those that are expected."""


def glb(paths: Sequence[Path], hands: ExportedHands) -> Iterator[Pair]:
    for path, scene in zip(paths, hands.scenes, strict=True):
        file = GlbReader(path.read_bytes())
        for one in scene.hands:
            expected = in_camera(one.trajectory, hands.hand).vertices.double().numpy() * TO_GLTF
            for time, vertices in zip(one.trajectory.times.tolist(), expected, strict=True):
                yield file.posed(one.name, time + 1e-6), vertices


def bvh(paths: Sequence[Path], hands: ExportedHands) -> Iterator[Pair]:
    for path, (_, one) in zip(paths, hands, strict=True):
        file = BvhReader(path.read_text())
        for frame, joints in zip(
            one.trajectory.frames, expected_joints(one.trajectory, hands.hand), strict=True
        ):
            places = file.positions(file.values[frame - one.trajectory.frames[0]])
            found = np.stack(
                [places[f"{one.trajectory.side}_{name}".replace(" ", "_")] for name in JOINTS]
            )
            yield found, joints * TO_GLTF


def usd(paths: Sequence[Path], hands: ExportedHands) -> Iterator[Pair]:
    from tests.support.usd_reader import UsdHands

    for path, scene in zip(paths, hands.scenes, strict=True):
        file = UsdHands(path)
        for one in scene.hands:
            posed = in_camera(one.trajectory, hands.hand)
            for row, time in enumerate(one.trajectory.times.tolist()):
                vertices = posed.vertices[row].double().numpy() * TO_GLTF
                yield file.joints(one.name, time), posed.joints[row].double().numpy() * TO_GLTF
                yield file.vertices(one.name, time), vertices
                yield file.own_vertices(one.name, time), vertices


def meshes(paths: Sequence[Path], hands: ExportedHands) -> Iterator[Pair]:
    frames = [(scene, frame) for scene in hands.scenes for frame in scene.frames]
    for path, (scene, frame) in zip(paths, frames, strict=True):
        read: Any = trimesh.load(path, process=False, maintain_order=True)
        expected = [
            in_camera(one, hands.hand).vertices[one.frames == frame][0].double().numpy()
            for one in scene.trajectories
            if frame in one.frames
        ]
        parts = list(read.geometry.values()) if isinstance(read, trimesh.Scene) else [read]
        assert all(part.volume > 1e-4 for part in parts)
        yield np.concatenate([part.vertices for part in parts]), np.concatenate(expected)


def clinical(columns: dict[str, np.ndarray]) -> Float[np.ndarray, "row joint=15 axis=3"]:
    """Joint angles, radians, from clinical names: the twin of the table, written out."""
    angles = np.zeros((len(next(iter(columns.values()))), 15, 3))
    for joint, name in enumerate(ARTICULATED):
        finger, part = name.split()
        sideways = "radial_deviation"
        if finger == "thumb" or (part == "MCP" and finger != "middle"):
            sideways = "abduction"
        sign = -1 if part == "MCP" and finger in ("ring", "little") else 1
        angles[:, joint, AXES.index("bend")] = columns[f"{finger}_{part}_flexion"]
        angles[:, joint, AXES.index("splay")] = sign * columns[f"{finger}_{part}_{sideways}"]
        angles[:, joint, AXES.index("twist")] = columns[f"{finger}_{part}_pronation"]
    return np.radians(angles)


def joints_of_angles(
    hand: HandModel, one: ExportedHand, angles: Float[np.ndarray, "frame joint=15 axis=3"]
) -> Pair:
    """Joints of a right hand with angles that were found, and with its own."""
    shape = torch.as_tensor(one.trajectory.shape).float().expand(len(angles), -1)
    pair = [hand(torch.as_tensor(those).float(), shape).joints.numpy()
            for those in (angles, one.trajectory.joint_angles)]  # fmt: skip
    return pair[0], pair[1]


def table(paths: Sequence[Path], hands: ExportedHands) -> Iterator[Pair]:
    with paths[0].open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    for scene, one in hands:
        own = [row for row in rows if (row["scene"], int(row["hand"])) == (
            scene.name, one.trajectory.hand)]  # fmt: skip
        assert [int(row["frame"]) for row in own] == one.trajectory.frames.tolist()
        columns = {
            name.removesuffix("_deg"): np.array([float(row[name]) for row in own])
            for name in own[0]
            if name.endswith("_deg")
        }
        yield joints_of_angles(hands.hand, one, clinical(columns))


def trc(paths: Sequence[Path], hands: ExportedHands) -> Iterator[Pair]:
    for path, (_, one) in zip(paths, hands, strict=True):
        file = read_trc(path)
        assert file.names == [name.replace(" ", "_") for name in LANDMARKS]
        rows = one.trajectory.frames - one.trajectory.frames[0]
        missing = np.setdiff1d(np.arange(len(file.points)), rows)
        assert np.isnan(file.points[missing]).all()
        yield file.points[rows], one.landmarks * TO_GLTF


def mot(paths: Sequence[Path], hands: ExportedHands) -> Iterator[Pair]:
    for path, (_, one) in zip(paths, hands, strict=True):
        columns, header = read_mot(path)
        assert header["inDegrees"] == "yes"
        rows = one.trajectory.frames - one.trajectory.frames[0]
        times = columns.pop("time")
        np.testing.assert_allclose(times[rows], one.trajectory.times, atol=1e-6)
        angles = clinical({name: values[rows] for name, values in columns.items()})
        yield joints_of_angles(hands.hand, one, angles)


def xr(paths: Sequence[Path], hands: ExportedHands) -> Iterator[Pair]:
    """Joints of OpenXR, WebXR and Unity that are landmarks, by their places in the specifications' tables."""
    for path, scene in zip(paths, hands.scenes, strict=True):
        content = json.loads(path.read_text())
        first = {"O": 1, "W": 0, "U": 0}[content["format"][0]]
        thumb = {"O": 2, "W": 1, "U": 2}[content["format"][0]]
        at = [first, *range(thumb, thumb + 4)]
        at += [thumb + 5 * finger + part for finger in range(1, 5) for part in range(4)]
        signs = np.array([1.0, 1.0, -1.0 if content["format"][0] == "U" else 1.0])
        for entry, one in zip(content["hands"], scene.hands, strict=True):
            found = [frame["positions"] for frame in entry["frames"] if frame["is_active"]]
            # The hand that is exported has rotation centres as landmarks, and its own tips.
            yield np.array(found)[:, at] * signs, one.landmarks * TO_GLTF


def dex(paths: Sequence[Path], hands: ExportedHands) -> Iterator[Pair]:
    for path, (_, one) in zip(paths, hands, strict=True):
        with np.load(path) as file:
            back = np.einsum("fxy,fly->flx", file["wrist_rotation"], file["points"])
            yield back + file["wrist"][:, None], one.landmarks


def rerun(paths: Sequence[Path], hands: ExportedHands) -> Iterator[Pair]:
    reader = pytest.importorskip("rerun.chunk", reason="needs a rerun-sdk that reads its files")
    for path, scene in zip(paths, hands.scenes, strict=True):
        found: dict[tuple[str, int], np.ndarray] = {}
        for chunk in reader.RrdReader(path).stream():
            column, entity = "Points3D:positions", str(chunk.entity_path)
            batch = chunk.to_record_batch()
            if column in batch.schema.names:
                for frame, points in zip(
                    batch["frame"].to_pylist(), batch[column].to_pylist(), strict=True
                ):
                    found[entity.split("/")[2], frame] = np.array(points)
        expected = {
            (one.name, frame): points
            for one in scene.hands
            for frame, points in zip(one.trajectory.frames.tolist(), one.landmarks, strict=True)
        }
        assert found.keys() == expected.keys()
        for key, points in expected.items():
            yield found[key], points


READERS: dict[str, Callable[[Sequence[Path], ExportedHands], Iterator[Pair]]] = {
    "glb": glb, "bvh": bvh, "usd": usd, "obj": meshes, "ply": meshes, "csv": table, "trc": trc, "mot": mot,
    "openxr": xr, "webxr": xr, "unity": xr, "dex": dex, "rerun": rerun,
}  # fmt: skip


@pytest.mark.parametrize("made", [clip, photographs])
@pytest.mark.parametrize("name", READERS)
def test_points_are_those_that_were_written(
    hand: HandModel, tmp_path: Path, name: str, made: Callable[[HandModel], ExportedHands]
) -> None:
    if not FORMATS[name].is_available:
        pytest.skip(
            f"needs {FORMATS[name].module}: pip install 'hand_recon[{FORMATS[name].extra}]'"
        )
    hands = made(hand)
    errors = [
        np.linalg.norm(found - expected, axis=-1).max()
        for found, expected in READERS[name](write(name, hands, tmp_path), hands)
    ]
    logger.info(
        "%s, %s: %.5f mm in %d arrays", name, made.__name__, 1000 * max(errors), len(errors)
    )
    assert max(errors) < TENTH_OF_A_MILLIMETRE


@pytest.fixture(scope="module")
def mano_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both hands of a file in MANO's format."""
    return write_mano_folder(tmp_path_factory.mktemp("mano"))


@pytest.mark.parametrize("made", [clip, photographs])
def test_manos_own_layer_poses_the_hand_that_was_written(
    mano_folder: Path, tmp_path: Path, made: Callable[[HandModel], ExportedHands]
) -> None:
    hand = mano_hand(mano_folder)
    hands = made(hand)
    layers = {
        side: ManoLayer.load(mano_folder, side, dtype=torch.float64) for side in ("left", "right")
    }
    largest = 0.0
    for path, (_, one) in zip(write("mano", hands, tmp_path), hands, strict=True):
        with np.load(path) as file:
            assert bool(file["flat_hand_mean"])
            layer = layers["right" if file["is_right"] else "left"]
            arrays = [
                torch.from_numpy(file[name]) for name in ("global_orient", "hand_pose", "transl")
            ]
            betas = torch.from_numpy(file["betas"]).expand(len(arrays[0]), -1)
        posed = layer(arrays[0], arrays[1], betas, arrays[2])
        expected = in_camera(one.trajectory, hand)
        for found, those in ((posed.joints, expected.joints), (posed.vertices, expected.vertices)):
            largest = max(largest, float((found - those).norm(dim=-1).max()))
    logger.info("mano, %s: %.5f mm", made.__name__, 1000 * largest)
    assert largest < TENTH_OF_A_MILLIMETRE


def test_landmarks_of_the_joints_are_the_joints(hand: HandModel) -> None:
    """The fixture's hand has rotation centres as landmarks, on which `xr` relies."""
    (scene,) = clip(hand).scenes
    for one in scene.hands:
        joints = expected_joints(one.trajectory, hand)
        np.testing.assert_allclose(one.landmarks[:, list(LANDMARK_OF_JOINT)], joints, atol=1e-6)
