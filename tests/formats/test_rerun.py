"""Recordings for Rerun: ellipsoids of covariances, and hands that are cleared where they are missing."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_recon.formats.by_name import FORMATS
from hand_recon.formats.rerun_recording import ellipsoids, write_rerun
from hand_recon.hand.model import HandModel
from tests.support.exported import clip


def test_an_ellipsoid_has_the_standard_deviations_along_its_axes() -> None:
    rng = np.random.default_rng(0)
    deviations = rng.uniform(0.001, 0.01, (6, 3))
    axes = Rotation.random(6, random_state=1).as_matrix()
    covariance = axes * deviations[:, None] ** 2 @ axes.swapaxes(1, 2)
    half_sizes, quaternions = ellipsoids(covariance)
    found = Rotation.from_quat(quaternions).as_matrix()
    np.testing.assert_allclose(np.linalg.det(found), 1.0)
    again = found * half_sizes[:, None] ** 2 @ found.swapaxes(1, 2)
    np.testing.assert_allclose(again, covariance, atol=1e-15)
    np.testing.assert_allclose(np.sort(half_sizes), np.sort(deviations))


def test_a_covariance_of_a_plane_has_a_flat_ellipsoid() -> None:
    half_sizes, _ = ellipsoids(np.diag([4e-6, 0.0, 1e-6])[None])
    np.testing.assert_allclose(np.sort(half_sizes[0]), [0.0, 0.001, 0.002], atol=1e-12)


def test_a_hand_is_cleared_where_it_is_missing(hand: HandModel, tmp_path: Path) -> None:
    if not FORMATS["rerun"].is_available:
        pytest.skip("needs rerun: pip install 'hand_recon[rerun]'")
    reader = pytest.importorskip("rerun.chunk", reason="needs a rerun-sdk that reads its files")
    cleared: dict[str, set[int]] = {}
    meshes: dict[str, set[int]] = {}
    path = write_rerun(tmp_path / "new" / "a.rrd", clip(hand).scenes[0], hand)
    for chunk in reader.RrdReader(path).stream():
        batch = chunk.to_record_batch()
        _, *names = str(chunk.entity_path).strip("/").split("/")
        if "Clear:is_recursive" in batch.schema.names:
            cleared.setdefault(names[0], set()).update(batch["frame"].to_pylist())
        if "Mesh3D:vertex_positions" in batch.schema.names:
            meshes.setdefault(names[0], set()).update(batch["frame"].to_pylist())
    assert cleared == {"hand_1_left": {4, 5}, "hand_2_right": {0, 1, 2}}
    assert meshes == {"hand_1_left": {0, 1, 2, 6, 7, 8, 9}, "hand_2_right": {4, 5, 6, 7, 8, 9}}
