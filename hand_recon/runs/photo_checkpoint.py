"""Checkpoints of networks that look at photographs: `hand-recon predict … ckpt=<run>` (decision 71)."""

import hashlib
import logging
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from omegaconf import DictConfig, open_dict

from hand_recon.hand.model import HandModel
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.lifter_file import fingerprint
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.runs.checkpoint_files import checkpoint_at
from hand_recon.runs.configuration import build_hand
from hand_recon.runs.lifters import DEFAULT, SUFFIX, names_lifter
from hand_recon.runs.photo_crops import crop_policy
from hand_recon.runs.photo_network import PhotoNetwork
from hand_recon.runs.unfinished import file_state

logger = logging.getLogger(__name__)

BOX_DETECTORS: Final = (
    "hand_recon.detection.boxes.BoxDetector",
    "hand_recon.detection.boxes.WholeImageDetector",
)
"""Detectors that, beside a network, give boxes alone."""


def with_network(config: DictConfig) -> tuple[DictConfig, PhotoNetwork | None]:
    """Load the network that a configuration names, and adapt the fit to it.

    The network's start takes the place of the lifter's. A detector that gives boxes alone has no landmark
    set: the fit is then of that of the network's landmarks.

    Args:
        config: `conf/predict.yaml` composed, adapted to its data.

    Returns:
        The configuration, and the network; the configuration as it is and None where `ckpt` is null.

    Raises:
        FileNotFoundError: There is no such checkpoint.
        ValueError: It is that of a lifter or of another hand model; or a lifter is given, too.
    """
    if config.get("ckpt") is None:
        return config, None
    if names_lifter(config.lifter) and config.lifter != DEFAULT:
        raise ValueError(
            f"Found ckpt={config.ckpt} and lifter={config.lifter}; each gives the start of a fit. Give one "
            "of them."
        )
    file = checkpoint_file(config.ckpt)
    regressor, trained, factor = _loaded(
        str(file), tuple(file_state(file)), _Wanted(build_hand(config))
    )
    landmark_set = str(trained.hand.landmark_set)
    boxes_alone = gives_boxes_alone(config)
    same = landmark_set == str(config.hand.landmark_set)
    if not same:
        _note_landmark_set(config, landmark_set, boxes_alone=boxes_alone)
    config = config.copy()
    with open_dict(config):
        config.lifter = "none"
        if boxes_alone:
            config.hand.landmark_set = landmark_set
    network = PhotoNetwork(
        regressor,
        crop_policy(trained),
        origin_name(file),
        sees_landmarks=same and isinstance(regressor.encoder, PhotoEncoder),
        finds_landmarks=same or boxes_alone,
        sees_pose=config.seen_pose_weight > 0 and config.descent.steps > 0,
        sigma_factor=factor if config.calibrated_sigma else 1.0,
    )
    return config, network


class _Wanted:
    """The hand that a checkpoint should be of; equal for equal hands, as a key of a cache."""

    def __init__(self, hand: HandModel) -> None:
        self.name, self.fingerprint = hand.name, fingerprint(hand)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Wanted) and other.fingerprint == self.fingerprint

    def __hash__(self) -> int:
        return hash(self.fingerprint)


@lru_cache(maxsize=2)
def _loaded(
    file: str, state: tuple[Any, ...], wanted: _Wanted
) -> tuple[Regressor, DictConfig, float]:
    """A network, the configuration of its training and its factor of σ, kept for the next Python call.

    Args:
        file: The checkpoint.
        state: `file_state` of it: a changed file is read again.
        wanted: The hand that is fitted.
    """
    del state
    # Checkpoints need Lightning, which takes seconds to import.
    from hand_recon.runs.checkpoints import HAND_KEY, load_trained, read_checkpoint

    # Before the network is built, since another hand's files may not be here.
    hand = read_checkpoint(file)[0].get(HAND_KEY)
    if hand is not None and hand != wanted.fingerprint:
        raise ValueError(
            f"ckpt={file} was trained with the hand {hand!r}; found {wanted.fingerprint!r}, whose angles and "
            f"shapes mean something else. Use hand={str(hand).split()[0]}, or a network that was trained "
            f"with hand={wanted.name}."
        )
    trained = load_trained(file)
    regressor = trained.module.regressor
    if isinstance(regressor.encoder, LandmarkEncoder):
        raise ValueError(
            f"ckpt={file} is a lifter: it sees landmarks, and no photograph. Give it as lifter={file}, or as "
            "ckpt a network of hand-recon train recipe=photos."
        )
    # Cameras of photographs are always known, be it by assumption: the hand is placed before them.
    regressor.use_intrinsics = True
    if isinstance(regressor.encoder, PhotoEncoder):
        regressor.encoder.gives_landmarks = True
    return regressor, trained.config, trained.sigma_factor


def checkpoint_file(name: str) -> Path:
    """File of a checkpoint: itself, or the best one of a run's folder.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is a lifter's file.
    """
    file = checkpoint_at(name)
    if not file.is_file():
        raise FileNotFoundError(
            f"No checkpoint at {file}. Give ckpt=<folder of a run> of hand-recon train recipe=photos, or its "
            "checkpoints/best.ckpt; ckpt=null looks at landmarks alone."
        )
    if file.suffix == SUFFIX:
        raise ValueError(
            f"{file} is the file of a lifter, which does not look at photographs. Give it as lifter={name}."
        )
    return file


def origin_name(file: Path) -> str:
    """Name of a checkpoint in the origin of hands: the end of its path and the start of its SHA-256."""
    parts = file.absolute().parts[-3 if file.parent.name == "checkpoints" else -1 :]
    with file.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return f"checkpoint {'/'.join(parts)} {digest[:12]}"


def gives_boxes_alone(config: DictConfig) -> bool:
    """True if the detector of a configuration with a checkpoint gives boxes without landmarks."""
    return config.get("ckpt") is not None and config.detector.get("_target_") in BOX_DETECTORS


def _note_landmark_set(config: DictConfig, trained: str, *, boxes_alone: bool) -> None:
    if boxes_alone:
        logger.info(
            "The landmarks that the network finds are of the set %s, which is fitted.", trained
        )
    else:
        logger.warning(
            "The network was trained on landmarks of the set %s, and the detector's are of %s: it sees the "
            "crop alone, and the fit has the detector's landmarks. If they are of %s, add landmark_set=%s.",
            trained, config.hand.landmark_set, trained, trained,
        )  # fmt: skip
