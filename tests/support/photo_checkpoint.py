"""Checkpoints of small untrained networks, as a run of training leaves them."""

from pathlib import Path

import torch
from omegaconf import DictConfig, open_dict

from hand_recon import __version__
from hand_recon.regressor.lifter_file import fingerprint
from hand_recon.runs.building import build_module
from hand_recon.runs.checkpoints import CONFIG_KEY, HAND_KEY, MEAN_POSE_KEY, VERSION_KEY
from hand_recon.runs.configuration import plain
from hand_recon.runs.fit_run import adapted_to_data
from hand_recon.runs.photo_checkpoint import with_network
from hand_recon.runs.photo_network import PhotoNetwork
from tests.support.configurations import composed

LABELS = ("data=landmarks", "data.train=labels.json", "data.landmark_set=mediapipe")
"""Data of training: photographs with landmarks as MediaPipe places them."""

PHOTOS = (
    *LABELS, "model=photos", "model.encoder.weights=none", "model.width=32",
    "model.encoder.landmarks.width=32",
    "model.encoder.width=16", "model.encoder.map_width=8", "crop_size=64",
)  # fmt: skip
"""A network that sees crops of 64 pixels, and landmarks."""

IMAGES = (
    *LABELS, "model=resnet18", "model.encoder.backbone=mobilenet_v3_small", "model.encoder.weights=none",
    "model.width=32", "crop_size=48",
)  # fmt: skip
"""A network that sees crops of 48 pixels alone."""

LIFTER = ("recipe=lifter", "model.width=16", "data.landmark_set=mediapipe")
"""A lifter."""


def write_run(folder: Path, *overrides: str, sharpness: float = 1.0) -> Path:
    """Write the folder of a run whose best checkpoint has random weights.

    Args:
        folder: The folder, which is made.
        overrides: Of `conf/train.yaml`.
        sharpness: Factor of the maps that landmarks are found by: with 1, all are found near the middle of
            the crop; with a large one, each is found at a place of its own.
    """
    config = composed(*overrides)
    with open_dict(config):
        del config["hydra"]
        config.paths = {"cache": "cache", "output": "output", "run": "run"}
    with torch.random.fork_rng():
        torch.manual_seed(3)
        module = build_module(config)
        with torch.no_grad():
            for name, parameter in module.regressor.named_parameters():
                if name.startswith("decoders.") and name.endswith("weight"):
                    # Predictions that differ from hand to hand.
                    parameter.normal_(0.0, 0.02)
                if name == "encoder.maps.maps.0.weight":
                    parameter.mul_(sharpness)
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


def write_networks(folder: Path) -> Path:
    """Write runs of untrained networks, `photos` and `images`, into a folder.

    Args:
        folder: The folder, which is returned.
    """
    write_run(folder / "photos", *PHOTOS, sharpness=1e4)
    write_run(folder / "images", *IMAGES)
    return folder


def asked(*words: str) -> DictConfig:
    """Configuration of `hand-recon predict`, adapted to its data.

    Args:
        words: Overrides of `conf/predict.yaml`.
    """
    return adapted_to_data(composed("input=[]", *words, name="predict"))


def loaded(run: Path, *words: str) -> PhotoNetwork:
    """The network of a run, as `hand-recon predict` loads it.

    Args:
        run: Folder of the run.
        words: Further overrides of `conf/predict.yaml`.
    """
    network = with_network(asked(f"ckpt='{run}'", *words))[1]
    assert network is not None
    return network
