"""Checks of a command for videos before its first frame, so that nothing is found out after an hour."""

import numpy as np
import torch
from omegaconf import DictConfig

from hand_recon.fitting.descent import Descent, last_stage, refuse_without_derivatives
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.photo_camera import parse_camera
from hand_recon.fitting.second_order.data_weights import is_likelihood
from hand_recon.runs.configuration import build_hand, instantiate
from hand_recon.runs.fitters import build_objective
from hand_recon.runs.lifters import names_lifter

_BY_FILE = ("landmarks", "boxes")
"""Settings of detectors that look the hands of an image up by its file."""


def check_clip(config: DictConfig) -> None:
    """Refuse options that videos and cameras do not have, and fits that cannot give several minima.

    Args:
        config: `conf/predict.yaml` composed and adapted.

    Raises:
        FileNotFoundError: There is no file of the camera.
        ValueError: An option is for photographs, out of its range, or of a fit of single photographs.
    """
    _refuse_options_of_photographs(config)
    instantiate(config.motion)
    choice = parse_camera(str(config.camera), 1)
    if choice.cameras is None:
        # A clip has no EXIF; any size does.
        choice.of_photo((1, 1), None, np.zeros(0))
    _refuse_other_fits(config)


def _refuse_options_of_photographs(config: DictConfig) -> None:
    if config.json is not None:
        raise ValueError(
            f"json={config.json} is for photographs. The hands of a video are in hands.json, or in "
            "hands.jsonl if they are many, of the folder that output=<folder> names; leave json out."
        )
    if config.results.meshes is not None:
        raise ValueError(
            f"results.meshes={config.results.meshes} is for photographs. The moving meshes of a video are in "
            "hands.glb (motion.glb=true); leave results.meshes out."
        )
    if not config.results.overlays:
        raise ValueError(
            "results.overlays=false is for photographs. motion.video=null leaves out the drawn video."
        )
    for name in _BY_FILE:
        if name in config.detector:
            raise ValueError(
                f"detector={name} looks hands up by the file of an image, which frames of a video do not "
                "have. Leave it out, or take the images as photographs, without motion.fps."
            )


def _refuse_other_fits(config: DictConfig) -> None:
    """Refuse fits that do not end in several minima of each hand.

    Raises:
        ValueError: The fit is by Adam, is none, or has no start.
    """
    descent: Descent = instantiate(config.descent)
    if descent.solver != "second_order":
        raise ValueError(
            f"descent.solver={descent.solver} gives one result for each hand, and a clip chooses among "
            "several. Leave it out; photographs may have it."
        )
    if descent.steps == 0:
        raise ValueError(
            "descent.steps=0 takes a network's hands without a fit, and a clip chooses among the minima of a "
            "fit. Leave it out; photographs may have it."
        )
    if not descent.starts and not names_lifter(config.lifter) and config.ckpt is None:
        raise ValueError(
            "Found descent.starts=0 and no lifter; expected one start or more per hand. Set descent.starts "
            "to 1, 2, 3 or 4, or give a lifter."
        )
    objective = build_objective(config, build_hand(config))
    refuse_without_derivatives(objective)
    one_hand = Observation(
        torch.zeros(1, 21, 2), torch.ones(1, 21, dtype=torch.bool), torch.eye(3)[None]
    )
    if not is_likelihood(last_stage(objective.data_term, one_hand, descent)):
        raise ValueError(
            "This data term is no likelihood, and a clip weighs frames and minima by their probability. Use "
            "data_term=mse_then_nll, the default, or laplace, without keep_balance=true."
        )
