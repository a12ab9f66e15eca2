"""Crops of the hands of a photograph, cut as the training of a network cuts them (Sec. 4.1)."""

import logging
from dataclasses import replace
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, UInt8
from omegaconf import DictConfig

from hand_recon.data.crop import (
    CropPolicy,
    HandRegion,
    crop_image,
    crop_intrinsics,
    crop_mirror,
    crop_points,
)
from hand_recon.data.landmarks.image_files import hand_frames
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.detection.detector import DetectedHand
from hand_recon.schema import HandSample

logger = logging.getLogger(__name__)

ABOUT_HANDS: Final = ("joints", "box", "mask")
"""Crops of `CropPolicy.around` whose size follows that of the hand."""


def crop_policy(trained: DictConfig) -> CropPolicy:
    """Size and place of the crops that a network was trained on, about landmarks or a box.

    Where the training's crops were no squares about the hand (rendered hands, whole images), those here are
    1.5 times the hand's box, which is how large rendered hands are; a note says so for whole images.

    Args:
        trained: Configuration of the training. Of a mixture, the part that is scored counts if it has such
            crops, else the first that has.
    """
    parts = trained.data.get("parts", {})
    scored = parts.get(trained.data.get("score_on"))
    several = [trained.data, scored, *parts.values()]
    found = [part.crop for part in several if part is not None and part.get("crop") is not None]
    for crop in found:
        if crop.around in ABOUT_HANDS:
            around = "joints" if crop.around == "mask" else crop.around
            return CropPolicy(int(crop.size), around, float(crop.expansion))
    if found:
        logger.info(
            "The network was trained on crops around=%s of its data. Here they are %g times the box of each "
            "hand; networks for photographs are trained with data.crop.around=joints.",
            found[0].around, CropPolicy.expansion,
        )  # fmt: skip
    return CropPolicy(int(trained.crop_size), "joints")


def frame_of(hand: DetectedHand, around: str) -> Float[np.ndarray, "4"]:
    """Box that the crop of a hand is made around, by the rule of the training (`hand_frames`).

    Args:
        hand: Hand with landmarks.
        around: `joints` or `box`.

    Returns:
        Left, top, right and bottom, pixels of the image.
    """
    points = torch.from_numpy(np.asarray(hand.landmarks_2d, dtype=np.float64))[None]
    landmarks = ImageLandmarks(
        landmarks_2d=points,
        labelled=points.isfinite().all(dim=-1),
        left=torch.tensor([hand.side == "left"]),
        names=("",),
        hand_boxes=None if hand.box is None else torch.from_numpy(hand.box)[None].double(),
    )
    return np.asarray(hand_frames(landmarks, around)[0].numpy())


def sample_of(
    pixels: UInt8[np.ndarray, "height width 3"],
    hand: DetectedHand,
    frame: Float[np.ndarray, "4"],
    policy: CropPolicy,
    camera: Float[np.ndarray, "3 3"] | None = None,
) -> tuple[HandSample, Float[np.ndarray, "3 3"]]:
    """Cut a hand out as `AnnotatedImages` does; a left hand is mirrored.

    Args:
        pixels: The photograph, RGB.
        hand: The hand, with its landmarks, or without any.
        frame: Box that the crop is made around, of `frame_of`.
        policy: Size of the crop, and of its square as a multiple of the box.
        camera: Camera matrix, pixels of the photograph.

    Returns:
        The sample, and the matrix from pixels of the photograph to pixels of the crop.
    """
    region = HandRegion(landmarks=hand.landmarks_2d, box=frame)
    matrix = replace(policy, around="box").matrix((pixels.shape[0], pixels.shape[1]), region)
    left = hand.side == "left"
    if left:
        matrix = crop_mirror(policy.size) @ matrix
    crop = crop_image(pixels, matrix, policy.size)
    points = crop_points(np.asarray(hand.landmarks_2d, dtype=np.float64), matrix)
    if camera is not None:
        # The camera's x axis is mirrored too, so that f_x stays positive in a mirrored crop.
        camera = crop_intrinsics(camera, matrix) * np.array([-1.0 if left else 1.0, 1.0, 1.0])
    sample = HandSample(
        image=torch.from_numpy(np.ascontiguousarray(crop.transpose(2, 0, 1))),
        landmarks_2d=torch.from_numpy(points).float(),
        labelled=torch.from_numpy(np.isfinite(points).all(axis=-1)),
        index=0,
        source="",
        intrinsics=None if camera is None else torch.from_numpy(camera).float(),
        confidence=None
        if hand.confidence is None
        else torch.from_numpy(np.asarray(hand.confidence)).float(),
        mirrored=left,
    )
    return sample, matrix
