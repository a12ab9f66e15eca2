"""Exported GLB files: what their extras hold, and the verdict of Khronos' validator where it is installed."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from hand_recon.formats.by_name import write
from hand_recon.formats.glb_extras import glb_extras
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARKS
from tests.support.exported import clip, photographs
from tests.support.glb_reader import GlbReader
from tests.support.trajectories import TO_GLTF

VALIDATE = """
const fs = require("fs"), validator = require("gltf-validator");
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))
  .then((report) => process.stdout.write(JSON.stringify(report.issues)));
"""


def test_extras_hold_the_covariance_in_the_scenes_axes(hand: HandModel, tmp_path: Path) -> None:
    hands = clip(hand)
    file = GlbReader(write("glb", hands, tmp_path)[0].read_bytes())
    for one in hands.scenes[0].hands:
        extras = file.nodes[file.named(one.name)]["extras"]
        assert (extras["hand"], extras["side"]) == (one.trajectory.hand, one.trajectory.side)
        assert extras["frames"] == one.trajectory.frames.tolist()
        assert extras["landmarks"] == list(LANDMARKS)
        points = np.array(extras["landmarks_3d"])
        np.testing.assert_allclose(points, one.landmarks * TO_GLTF, atol=5.1e-7)
        found = np.array(extras["covariance_3d"])
        # The variance along a direction of the scene is that along the same direction of the camera.
        direction = np.array([0.6, -0.48, 0.64])
        variance = np.einsum("x,flxy,y->fl", direction, found, direction)
        turned = direction * TO_GLTF
        expected = np.einsum("x,flxy,y->fl", turned, one.covariance, turned)
        np.testing.assert_allclose(variance, expected, rtol=1e-3)


def test_a_frame_without_an_estimate_has_no_covariance(hand: HandModel) -> None:
    one = clip(hand).scenes[0].hands[1]
    one.covariance[2, 7, 0, 0] = np.nan
    found = glb_extras(one)["covariance_3d"]
    assert [values is None for values in found] == [False, False, True, False, False, False]


def test_khronos_validator_finds_nothing(hand: HandModel, tmp_path: Path) -> None:
    node, modules = shutil.which("node"), os.environ.get("HAND_RECON_GLTF_VALIDATOR")
    if node is None or modules is None:
        pytest.skip(
            "needs node, and HAND_RECON_GLTF_VALIDATOR with the folder node_modules in which "
            "`npm install gltf-validator` put it"
        )
    for made in (clip, photographs):
        for path in write("glb", made(hand), tmp_path):
            done = subprocess.run(  # noqa: S603  # node and our own script
                [node, "-e", VALIDATE, str(path)],
                env={**os.environ, "NODE_PATH": modules}, capture_output=True, text=True, check=True,
            )  # fmt: skip
            issues = json.loads(done.stdout)
            counts = [issues[f"num{kind}"] for kind in ("Errors", "Warnings", "Infos", "Hints")]
            assert counts == [0, 0, 0, 0], issues["messages"]
