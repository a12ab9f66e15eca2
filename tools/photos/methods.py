"""Ways from photographs to hands: a network with pixels, with landmarks too, and the fit behind."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import torch
from omegaconf import DictConfig
from torch import Tensor

from hand_recon.camera import REFERENCE_SIZE, default_intrinsics
from hand_recon.command_line.composing import composed
from hand_recon.data.augment import to_float
from hand_recon.fitting.descent import Descent, last_stage
from hand_recon.fitting.descent import fit as descend
from hand_recon.fitting.estimated import estimated_start
from hand_recon.fitting.objective import Fitted, Objective
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.seen_pose import believed
from hand_recon.fitting.shared_shape import shared_shape, with_shape
from hand_recon.fitting.start import Start
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.runs.configuration import instantiate
from hand_recon.runs.fit_run import adapted_to_data
from hand_recon.runs.fitters import build_objective
from hand_recon.schema import HandBatch, HandEstimate, HandPrediction
from photos.sets import PhotoSet

BATCH = 128

WAYS: Final = ("pixels", "pixels + fit", "both", "both + fit", "both + fit, one person")
"""Ways from photographs to hands."""


@dataclass(frozen=True)
class Refinement:
    """The second-order fit that starts from a network's hand."""

    objective: Objective
    descent: Descent

    @classmethod
    def of(cls, regressor: Regressor, overrides: tuple[str, ...] = ()) -> "Refinement":
        """The default fit, or another configuration of it, for a network's hand."""
        config: DictConfig = adapted_to_data(
            composed(
                "predict",
                # Any name: the network is here.
                [f"landmark_set={regressor.hand.landmark_set}", "ckpt=network", *overrides],
            )
        )
        return cls(build_objective(config, regressor.hand), instantiate(config.descent))

    def __call__(self, batch: HandBatch, seen: HandPrediction, pose: Tensor) -> HandPrediction:
        """Fit hands to the landmarks of a batch, from a prediction.

        Args:
            batch: Landmarks to fit, with their σ as `label_noise`, pixels of the crop.
            seen: The network's hands in the same crops.
            pose: Joint angles that the network sees in pixels alone, radians.
        """
        observation = self._observation(batch, seen, pose)
        found = self._fitted(observation, Start.one_each(seen.parameters))
        return _in_crops(found.prediction, batch, seen)

    def of_person(
        self, batch: HandBatch, seen: HandPrediction, pose: Tensor, found: HandPrediction
    ) -> HandPrediction:
        """Fit hands of one person, which share a shape (decision 69).

        Args:
            batch: As for a fit of any hands.
            seen: As there.
            pose: As there.
            found: The hands, each fitted alone.
        """
        observation = self._observation(batch, seen, pose)
        objective = self.objective
        last = replace(
            objective, data_term=last_stage(objective.data_term, observation, self.descent)
        )
        shape = shared_shape(observation, found.parameters, last)
        hand = objective.hand.of_shape(shape)
        of_person = replace(self, objective=replace(objective, hand=hand))
        start = estimated_start(observation, hand.landmarks_only())
        fitted = with_shape(of_person._fitted(observation, start), shape, objective.prior)
        return _in_crops(fitted.prediction, batch, seen)

    def _observation(self, batch: HandBatch, seen: HandPrediction, pose: Tensor) -> Observation:
        scale = REFERENCE_SIZE / batch.crop_size
        default = default_intrinsics(int(REFERENCE_SIZE), batch.landmarks_2d)
        cameras = default.expand(len(batch), 3, 3)
        if batch.intrinsics is not None:
            cameras = batch.intrinsics * torch.tensor([scale, scale, 1.0])[:, None]
        sigma = None if batch.label_noise is None else batch.label_noise * scale
        estimate = HandEstimate(seen.parameters, seen.log_sigma, pose)
        return Observation(batch.landmarks_2d * scale, batch.labelled, cameras, sigma, estimate)

    def _fitted(self, observation: Observation, start: Start) -> Fitted:
        descent = replace(self.descent, starts=0, hands_at_once=len(observation))
        return descend(observation, self.objective, descent=descent, further=lambda _: start)


def _in_crops(found: HandPrediction, batch: HandBatch, seen: HandPrediction) -> HandPrediction:
    """Fitted hands in pixels of the crops, with the network's σ."""
    scale = batch.crop_size / REFERENCE_SIZE
    return replace(found, landmarks_2d=found.landmarks_2d * scale, log_sigma=seen.log_sigma)


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
    parts = []
    for first in range(0, len(batch), BATCH):
        rows = slice(first, first + BATCH)
        parts.append(refinement(target.select(rows), seen.select(rows), pose[rows]))
    found = HandPrediction.join(parts)
    return refinement.of_person(target, seen, pose, found) if one_person else found


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
