"""Checkpoints of small untrained networks, as a run of training leaves them."""

from pathlib import Path

import torch
from lightning.pytorch import seed_everything
from omegaconf import open_dict

from hand_recon import __version__
from hand_recon.regressor.lifter_file import fingerprint
from hand_recon.runs.building import build_module
from hand_recon.runs.checkpoints import CONFIG_KEY, HAND_KEY, MEAN_POSE_KEY, VERSION_KEY
from hand_recon.runs.configuration import plain
from tests.support.configurations import composed

PHOTOS = (
    "recipe=photos", "data.train=labels.json", "model.encoder.weights=none", "model.width=32",
    "model.encoder.landmarks.width=32", "model.encoder.width=16", "model.encoder.map_width=8", "crop_size=64",
    "start_from=none",
)  # fmt: skip
"""A network of `recipe=photos` on crops of 64 pixels."""

IMAGES = (
    "data=landmarks", "data.train=labels.json", "model=resnet18", "model.width=32", "crop_size=48",
    "model.encoder.backbone=mobilenet_v3_small", "model.encoder.weights=none", "data.landmark_set=mediapipe",
)  # fmt: skip
"""A network that sees the crop alone, of 48 pixels."""

LIFTER = ("recipe=lifter", "model.width=16", "data.landmark_set=mediapipe")
"""A lifter."""


def write_run(folder: Path, *overrides: str, spread: float = 1.0) -> Path:
    """Write the folder of a run whose best checkpoint has random weights.

    Args:
        folder: The folder, which is made.
        overrides: Of `conf/train.yaml`.
        spread: Factor of the last weights: 1 leaves every hand near the mean one; larger ones move the
            predictions with the input.
    """
    config = composed(
        *overrides, "optimizer.fused=false" if "recipe=photos" in overrides else "seed=0"
    )
    with open_dict(config):
        del config["hydra"]
        config.paths = {"cache": "cache", "output": "output", "run": "run"}
    seed_everything(3, verbose=False)
    module = build_module(config)
    with torch.no_grad():
        for name in ("joint_angles", "root", "camera", "shape", "log_sigma"):
            decoder = module.regressor.decoders[name]
            decoder.weight.normal_(0.0, 0.02 * spread)
    (folder / "checkpoints").mkdir(parents=True)
    torch.save(
        {
            "state_dict": module.state_dict(),
            CONFIG_KEY: plain(config),
            HAND_KEY: fingerprint(module.regressor.hand),
            VERSION_KEY: __version__,
            MEAN_POSE_KEY: {},
        },
        folder / "checkpoints" / "best.ckpt",
    )
    return folder
