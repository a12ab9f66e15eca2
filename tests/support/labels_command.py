"""The configuration of `prepare labels` for landmarks of a file."""

from pathlib import Path

from omegaconf import DictConfig, open_dict

from tests.support.configurations import composed


def asked(folder: Path, *overrides: str) -> DictConfig:
    """`conf/prepare_labels.yaml` composed for the images of a folder and our landmarks."""
    config = composed(
        f"images='{folder}/photos'", "detector=landmarks", f"detector.landmarks='{folder}/found.json'",
        f"output='{folder}/out'", "fit=false", "sheets=0", *overrides, name="prepare_labels",
    )  # fmt: skip
    with open_dict(config):
        del config["hydra"]
    return config
