"""Ways from photographs to hands: a network with pixels, with landmarks too, and the fit behind."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from omegaconf import DictConfig
from torch import Tensor

from hand_recon.camera import REFERENCE_SIZE, default_intrinsics
from hand_recon.command_line.composing import composed
from hand_recon.data.augment import to_float
from hand_recon.fitting.descent import Descent
from hand_recon.fitting.descent import fit as descend
from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.start import Start
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.runs.configuration import instantiate
from hand_recon.runs.fit_run import adapted_to_data
from hand_recon.runs.fitters import build_objective
from hand_recon.schema import HandBatch, HandPrediction
from photos.sets import PhotoSet

BATCH = 128


@dataclass(frozen=True)
class Refinement:
    """The second-order fit that starts from a network's hand."""

    objective: Objective
    descent: Descent

    @classmethod
    def of(cls, regressor: Regressor, overrides: tuple[str, ...] = ()) -> "Refinement":
        """The default fit, or another configuration of it, for a network's hand."""
        config: DictConfig = adapted_to_data(
            composed("fit", [f"landmark_set={regressor.hand.landmark_set}", *overrides])
        )
        return cls(build_objective(config, regressor.hand), instantiate(config.descent))

    def __call__(self, batch: HandBatch, seen: HandPrediction) -> HandPrediction:
        """Fit hands to the landmarks of a batch, from a prediction.

        Args:
            batch: Landmarks to fit, with their σ as `label_noise`, pixels of the crop.
            seen: The network's hands in the same crops.
        """
        scale = REFERENCE_SIZE / batch.crop_size
        default = default_intrinsics(int(REFERENCE_SIZE), batch.landmarks_2d)
        cameras = default.expand(len(batch), 3, 3)
        if batch.intrinsics is not None:
            cameras = batch.intrinsics * torch.tensor([scale, scale, 1.0])[:, None]
        sigma = None if batch.label_noise is None else batch.label_noise * scale
        start = Start.one_each(seen.parameters)
        found = descend(
            Observation(batch.landmarks_2d * scale, batch.labelled, cameras, sigma),
            self.objective,
            descent=replace(self.descent, starts=0, hands_at_once=len(batch)),
            further=lambda _: start,
        ).prediction
        return replace(found, landmarks_2d=found.landmarks_2d / scale, log_sigma=seen.log_sigma)


@torch.no_grad()
def look(regressor: Regressor, batch: HandBatch, *, with_landmarks: bool) -> HandPrediction:
    """Predict hands, with or without the batch's landmarks as an input; known cameras are used."""
    encoder = regressor.encoder
    if isinstance(encoder, PhotoEncoder):
        encoder.gives_landmarks = with_landmarks
    regressor.use_intrinsics = batch.intrinsics is not None
    parts = []
    for first in range(0, len(batch), BATCH):
        part = batch.select(slice(first, first + BATCH))
        parts.append(regressor.eval()(to_float(part)))
    return HandPrediction.join(parts)


def refined(
    regressor: Regressor, refinement: Refinement, batch: HandBatch, *, with_landmarks: bool
) -> HandPrediction:
    """A network's hands, fitted to the landmarks that it was given, or to those that it found itself."""
    seen = look(regressor, batch, with_landmarks=with_landmarks)
    target = replace(batch, label_noise=None, confidence=None)
    if not with_landmarks:
        found = seen.landmarks_2d if seen.located_2d is None else seen.located_2d
        sigma: Tensor = seen.log_sigma.exp().square().mean(dim=-1).sqrt()
        target = replace(
            target,
            landmarks_2d=found,
            labelled=torch.ones_like(batch.labelled),
            label_noise=sigma * (batch.crop_size / REFERENCE_SIZE),
        )
    parts = []
    for first in range(0, len(batch), BATCH):
        rows = slice(first, first + BATCH)
        parts.append(refinement(target.select(rows), seen.select(rows)))
    return HandPrediction.join(parts)


def methods(regressor: Regressor) -> dict[str, Callable[[PhotoSet], HandPrediction]]:
    """Ways by name, in the order of tables."""
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
    return ways
