"""Ways from photographs to hands: a network with pixels, with landmarks too, and the fit behind."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import torch
from omegaconf import DictConfig
from torch import Tensor

from hand_recon.command_line.composing import composed
from hand_recon.data.augment import to_float
from hand_recon.fitting.seen_pose import believed
from hand_recon.hand.model import HandModel
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.runs.configuration import instantiate
from hand_recon.runs.fit_run import adapted_to_data
from hand_recon.runs.fitters import build_fitter, build_objective
from hand_recon.runs.one_person import MOST, one_person_fitter
from hand_recon.schema import REFERENCE_SIZE, HandBatch, HandEstimate, HandPrediction
from photos.sets import PhotoSet

BATCH = 128

WAYS: Final = ("pixels", "pixels + fit", "both", "both + fit", "both + fit, one person")
"""Ways from photographs to hands."""


@dataclass(frozen=True)
class Refinement:
    """The fit of `predict` beside a checkpoint, which starts from a network's hand."""

    config: DictConfig
    hand: HandModel

    @classmethod
    def of(cls, regressor: Regressor, overrides: tuple[str, ...] = ()) -> "Refinement":
        """The default fit, or another configuration of it, for a network's hand."""
        # Any checkpoint: the network is here.
        words = [f"landmark_set={regressor.hand.landmark_set}", "ckpt=network", *overrides]
        return cls(adapted_to_data(composed("predict", words)), regressor.hand)

    def __call__(
        self, batch: HandBatch, seen: HandPrediction, pose: Tensor, *, one_person: bool = False
    ) -> HandPrediction:
        """Fit hands to the landmarks of a batch, from a prediction.

        Args:
            batch: Landmarks to fit, with their σ as `label_noise`, pixels of the crop.
            seen: The network's hands in the same crops.
            pose: Joint angles that the network sees in pixels alone, radians.
            one_person: Whether the hands are one person's and share a shape (decision 69).

        Returns:
            Hands in pixels of the crops, with the network's σ.
        """
        hands = _to_fit(batch, HandEstimate(seen.parameters, seen.log_sigma, pose))
        fitter = build_fitter(self.config, self.hand)
        if one_person:
            every = max(1, -(-len(hands) // MOST))
            fitter = one_person_fitter(
                fitter,
                partial(build_fitter, self.config),
                build_objective(self.config, self.hand),
                instantiate(self.config.descent),
                hands.select(slice(None, None, every)),
            )
        parts = [fitter(hands.select(part)).prediction for part in _parts(hands)]
        found = HandPrediction.join(parts)
        scale = batch.crop_size / REFERENCE_SIZE
        return replace(found, landmarks_2d=found.landmarks_2d * scale, log_sigma=seen.log_sigma)


def _to_fit(batch: HandBatch, estimate: HandEstimate) -> HandBatch:
    """Landmarks of crops in crops of 224 pixels without images, with a network's estimates."""
    scale = REFERENCE_SIZE / batch.crop_size
    cameras = batch.intrinsics
    return replace(
        batch,
        image=torch.empty(len(batch), 3, 0, 0, dtype=torch.uint8),
        landmarks_2d=batch.landmarks_2d * scale,
        intrinsics=None
        if cameras is None
        else cameras * torch.tensor([scale, scale, 1.0])[:, None],
        label_noise=None if batch.label_noise is None else batch.label_noise * scale,
        estimate=estimate,
    )


def _parts(batch: HandBatch) -> list[slice]:
    return [slice(first, first + BATCH) for first in range(0, len(batch), BATCH)]


@torch.no_grad()
def look(regressor: Regressor, batch: HandBatch, *, with_landmarks: bool) -> HandPrediction:
    """Predict hands, with or without the batch's landmarks as an input; known cameras are used."""
    encoder = regressor.encoder
    if isinstance(encoder, PhotoEncoder):
        encoder.gives_landmarks = with_landmarks
    regressor.use_intrinsics = batch.intrinsics is not None
    regressor.eval()
    return HandPrediction.join([regressor(to_float(batch.select(part))) for part in _parts(batch)])


def refined(
    regressor: Regressor,
    refinement: Refinement,
    batch: HandBatch,
    *,
    with_landmarks: bool,
    one_person: bool = False,
) -> HandPrediction:
    """A network's hands, fitted to the landmarks that it was given, or to those that it found itself.

    Args:
        regressor: The network.
        refinement: The fit.
        batch: Crops with landmarks.
        with_landmarks: Whether the network and the fit are given these landmarks.
        one_person: Whether the hands are one person's and share a shape.
    """
    seen = look(regressor, batch, with_landmarks=with_landmarks)
    target = replace(batch, label_noise=None, confidence=None)
    if not with_landmarks:
        sigma: Tensor = seen.log_sigma.exp().square().mean(dim=-1).sqrt()
        target = replace(
            target,
            landmarks_2d=seen.found_2d,
            labelled=torch.ones_like(batch.labelled),
            label_noise=sigma * (batch.crop_size / REFERENCE_SIZE),
        )
    in_pixels = look(regressor, batch, with_landmarks=False) if with_landmarks else seen
    pose = in_pixels.parameters.joint_angles
    if with_landmarks:
        pose = believed(pose, in_pixels.found_2d, batch.landmarks_2d, batch.crop_size)
    return refinement(target, seen, pose, one_person=one_person)


def methods(
    regressor: Regressor, *, one_person: bool = False
) -> dict[str, Callable[[PhotoSet], HandPrediction]]:
    """Ways by name, in the order of tables.

    Args:
        regressor: The network.
        one_person: Whether the hands are one person's, so that there is a way for that.
    """
    refinement = Refinement.of(regressor)
    ways: dict[str, Callable[[PhotoSet], HandPrediction]] = {
        "pixels": lambda hands: look(regressor, hands.batch, with_landmarks=False),
        "pixels + fit": lambda hands: refined(
            regressor, refinement, hands.batch, with_landmarks=False
        ),
    }
    if isinstance(regressor.encoder, PhotoEncoder):
        ways["both"] = lambda hands: look(regressor, hands.batch, with_landmarks=True)
        ways["both + fit"] = lambda hands: refined(
            regressor, refinement, hands.batch, with_landmarks=True
        )
        if one_person:
            ways["both + fit, one person"] = lambda hands: refined(
                regressor, refinement, hands.batch, with_landmarks=True, one_person=True
            )
    return ways
