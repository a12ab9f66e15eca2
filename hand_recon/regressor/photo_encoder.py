"""Evidence from a crop, from a detector's landmarks, or from both (Sec. 4.1)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from hand_recon.camera import REFERENCE_SIZE, move_points
from hand_recon.hand.upright import upright_motion
from hand_recon.regressor.backbones import build_backbone
from hand_recon.regressor.encoder import Encoder, Evidence
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.landmark_maps import LandmarkMaps
from hand_recon.regressor.looks import Look, look_around
from hand_recon.schema import HandBatch

_UNIT: Final = 20.0
"""Unit of the difference between given and found landmarks, pixels of a 224-pixel crop."""

_LIMIT: Final = 10.0
"""Clip of this difference, in `_UNIT`s."""


class PhotoEncoder(Encoder):
    """Finds landmarks in the crop and joins them with features of the crop and with a detector's landmarks.

    The regressor compares its projections with the given landmarks where there are any, else with those
    found in the crop. Without an image, only the given landmarks count, as for a lifter.

    In training, the labels of some hands are given, moved by noise: moved, since the network would
    otherwise copy every label, errors included, and no σ could be learnt (decision 31).

    Args:
        backbone: Name of the backbone, as for `build_backbone`.
        weights: `imagenet`, `none`, or the path of a state dict.
        landmarks: Encoder of the landmarks.
        frozen: Number of leading layers of the backbone that keep their weights in training.
        width: Features of the crop as a whole.
        gives_landmarks: Whether the batch's landmarks are a detector's and are given to the network, outside
            of training.
        view: Side of the middle part of the crop that the network looks at, as a share of the crop's.
        turns: Outside of training, look at the crop turned by right angles, and at the surest of these
            turned further by these angles, in degrees; one look if there are none.
        given_share: Share of training hands whose landmarks are given.
        given_noise: Standard deviation of the noise of given landmarks in training, pixels of a 224-pixel
            crop.
        map_width: Channels of the features from which landmarks are found.
    """

    has_landmarks = True

    def __init__(
        self,
        backbone: str = "efficientnet_lite0",
        weights: str = "imagenet",
        *,
        landmarks: LandmarkEncoder,
        frozen: int = 0,
        width: int = 256,
        gives_landmarks: bool = False,
        view: float = 1.0,
        turns: Sequence[float] | None = None,
        given_share: float = 0.25,
        given_noise: float = 5.0,
        map_width: int = 96,
    ) -> None:
        super().__init__()
        self.backbone = build_backbone(backbone, weights, frozen)
        self.maps = LandmarkMaps(self.backbone.channels, map_width)
        self.summary = nn.Linear(self.backbone.channels[32], width)
        self.landmarks = landmarks
        self.gives_landmarks = gives_landmarks
        self.view = view
        self.turns = tuple(turns or ())
        self.given_share = given_share
        self.given_noise = given_noise
        self.feature_size = landmarks.feature_size + width + 42 + 2

    def forward(self, batch: HandBatch) -> Evidence:
        """Evidence about each hand.

        Raises:
            ValueError: There are neither images nor given landmarks.
        """
        if not batch.image.numel():
            return self._without_image(batch)
        if self.turns and not self.training:
            seen = look_around(self._look, batch.image, self.turns)
        else:
            seen = self._look(batch.image)
        # Mixed precision is for what looks at the image: bfloat16 rounds 200 pixels to whole ones.
        with torch.autocast(device_type=seen.landmarks.device.type, enabled=False):
            return self._joined(batch, seen)

    def _joined(self, batch: HandBatch, seen: Look) -> Evidence:
        """Evidence from found landmarks, a summary of the crop, and given landmarks."""
        given, visible = self._given(batch)
        known = visible.any(dim=-1)
        # The maps learn from labels alone: the rounds of feedback have a hundred times their gradient.
        found = seen.landmarks.detach()
        landmarks = torch.where(known[:, None, None], given, found)
        shown = visible | ~known[:, None]
        # Found landmarks have the spread of their maps as a confidence, given ones the detector's own.
        confidence = torch.exp(-10 * seen.spread.detach())
        detected = batch.confidence
        if detected is None:
            detected = torch.full_like(confidence, torch.nan)
        confidence = torch.where(known[:, None], detected, confidence)
        motion = upright_motion(landmarks, shown, batch.crop_size)
        landmarks = move_points(landmarks, motion.pixels)
        features = torch.cat(
            [
                self.landmarks.features(_seen(batch, landmarks, shown, confidence)),
                seen.summary,
                _difference(found - given, visible, batch.crop_size),
                known[:, None].float(),
                torch.ones_like(seen.summary[:, :1]),
            ],
            dim=-1,
        )
        return Evidence(features, landmarks, shown, motion, seen.landmarks)

    def _look(self, image: Float[Tensor, "batch 3 size size"]) -> Look:
        """Landmarks with their spread, and a summary of the crop, from one look at it."""
        size = image.shape[-1]
        border = round((1 - self.view) / 2 * size)
        middle = image[..., border : size - border, border : size - border]
        pyramid = self.backbone(middle)
        position, spread = self.maps(pyramid)
        share = middle.shape[-1] / size
        summary = torch.relu(self.summary(pyramid[32].mean(dim=(-2, -1)))).float()
        return Look(border + share * size * position, share * spread, summary)

    def _without_image(self, batch: HandBatch) -> Evidence:
        given, visible = self._given(batch)
        if not self.gives_landmarks and not self.training:
            raise ValueError(
                "These data have landmarks alone, and the model is asked to look at images only. Set "
                "model.encoder.gives_landmarks=true, or use data with images."
            )
        motion = upright_motion(given, visible, batch.crop_size)
        landmarks = move_points(given, motion.pixels)
        features = self.landmarks.features(_seen(batch, landmarks, visible, batch.confidence))
        rest = features.new_zeros(features.shape[0], self.feature_size - features.shape[-1])
        rest[:, -2] = 1.0
        return Evidence(torch.cat([features, rest], dim=-1), landmarks, visible, motion)

    def _given(
        self, batch: HandBatch
    ) -> tuple[Float[Tensor, "batch landmark=21 2"], Bool[Tensor, "batch landmark=21"]]:
        """Landmarks that are given, and for which of them this is so."""
        visible = batch.labelled
        points = batch.landmarks_2d.masked_fill(~visible[..., None], 0.0)
        if not self.training:
            return points, visible & self.gives_landmarks
        noise = self.given_noise * batch.crop_size / REFERENCE_SIZE
        moved = points + noise * torch.randn_like(points)
        share = self.given_share if batch.image.numel() else 1.0
        chosen = torch.rand(len(batch), 1, device=points.device) < share
        return moved, self.landmarks.shown(replace(batch, labelled=visible & chosen)).labelled


def _difference(
    difference: Float[Tensor, "batch landmark=21 2"],
    visible: Bool[Tensor, "batch landmark=21"],
    crop_size: int,
) -> Float[Tensor, "batch coordinate=42"]:
    """Found minus given landmarks in `_UNIT`s, clipped; zero where none is given."""
    difference = difference.masked_fill(~visible[..., None], 0.0)
    return (difference * (REFERENCE_SIZE / crop_size / _UNIT)).clamp(-_LIMIT, _LIMIT).flatten(1)


def _seen(
    batch: HandBatch,
    landmarks: Float[Tensor, "batch landmark=21 2"],
    visible: Bool[Tensor, "batch landmark=21"],
    confidence: Float[Tensor, "batch landmark=21"] | None,
) -> HandBatch:
    return replace(batch, landmarks_2d=landmarks, labelled=visible, confidence=confidence)
