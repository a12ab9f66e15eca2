"""Smoothed hands of a clip as records: posed again in their frames, judged, bridged ones marked."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int

from hand_recon import __version__
from hand_recon.fitting.descent import Descent, last_stage
from hand_recon.fitting.hand_records import SHAPES, HandRecords, joined_records
from hand_recon.fitting.in_parts import fit_part
from hand_recon.fitting.objective import Fitted, Objective
from hand_recon.fitting.observation import observed
from hand_recon.fitting.origin import Moment
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.fitting.second_order.solver import SecondOrder
from hand_recon.motion.posing import right_hands
from hand_recon.motion.trajectory import Trajectory, mirror_of
from hand_recon.runs.clip.hands_of_clip import HandOfClip
from hand_recon.schema import HandBatch
from hand_recon.uncertainty.covariance_correction import correction_named

OF_LANDMARKS: Final = ("score", "observed_2d", "sigma_2d", "covariance_3d", "residual")
"""Numbers that a hand does not have in a frame in which it was not seen."""

BRIDGED: Final = (
    "The hand was not seen in this frame: its pose follows from the frames before and after. A longer or "
    "shorter gap is bridged with motion.longest_gap."
)
"""Reason why a bridged hand is doubtful."""


@dataclass(frozen=True)
class SmoothedHand:
    """One hand of a clip with its motion."""

    hand: HandOfClip
    """Landmarks of the frames in which it was seen."""
    motion: Trajectory
    """Its pose in every frame from the first to the last, those that are too long a gap left out."""


@dataclass(frozen=True)
class ClipPoses:
    """Poses of smoothed hands in their frames, with the loss and the certainty there."""

    objective: Objective
    """Loss of the fit."""
    descent: Descent
    """Settings of the optimizer, for the stage of the data term in which it ends."""
    sigma_at_half_confidence: float
    """σ at confidence ½, pixels of a 224-pixel crop."""
    with_covariance: bool = True
    """True for the covariances of landmarks, which take most of the time."""

    @torch.no_grad()
    def __call__(
        self, smoothed: SmoothedHand, rows: Int[np.ndarray, " row"]
    ) -> tuple[HandRecords, Float[np.ndarray, "row vertex 3"]]:
        """Records and meshes of some frames of a hand, those in which it was seen first.

        Args:
            smoothed: The hand.
            rows: Positions of the frames in its motion, one or more.

        Returns:
            The records, and vertices in the camera's frame, metres, in the same order.
        """
        motion = smoothed.motion
        is_seen = motion.observed[rows]
        parts = []
        if is_seen.any():
            parts.append(self._seen(smoothed, rows[is_seen]))
        if not is_seen.all():
            parts.append(self._bridged(smoothed, rows[~is_seen]))
        records = joined_records([part for part, _ in parts])
        return records, np.concatenate([vertices for _, vertices in parts])

    def _seen(
        self, smoothed: SmoothedHand, rows: Int[np.ndarray, " row"]
    ) -> tuple[HandRecords, np.ndarray]:
        frames = np.searchsorted(smoothed.hand.track.frames, smoothed.motion.frames[rows])
        landmarks = smoothed.hand.landmarks.select(torch.from_numpy(frames))
        origins = tuple(smoothed.hand.origins[frame] for frame in frames.tolist())
        parameters = right_hands(smoothed.motion, rows)

        def posed(batch: HandBatch) -> Fitted:
            seen = observed(batch, self.sigma_at_half_confidence)
            last = last_stage(self.objective.data_term, seen, self.descent)
            objective = replace(self.objective, data_term=last)
            found = objective(parameters, seen)
            if not self.with_covariance:
                return found
            correction = correction_named(self.descent.error_bars)
            solver = SecondOrder.of(objective, finger_table=False, correction=correction)
            covariance = solver.covariance_at(seen, parameters)
            return replace(found, prediction=replace(found.prediction, covariance_3d=covariance))

        part = fit_part(landmarks, posed, origins)
        return to_records(part), part.prediction.vertices.double().numpy()

    def _bridged(
        self, smoothed: SmoothedHand, rows: Int[np.ndarray, " row"]
    ) -> tuple[HandRecords, np.ndarray]:
        """Records of frames between others: doubtful, without landmarks, σ and loss."""
        motion, origin = smoothed.motion, smoothed.hand.origins[0]
        parameters = right_hands(motion, rows)
        posed = self.objective.hand.to_camera(parameters)
        sign = mirror_of(motion.side)
        points = posed.landmarks.double().numpy() * sign
        intrinsics = smoothed.hand.landmarks.intrinsics
        if intrinsics is None:
            raise AssertionError
        count, camera = len(rows), intrinsics[0].double().numpy()
        pixels = points @ camera.T
        nothing = {key: np.full((count, *SHAPES[key]), np.nan) for key in OF_LANDMARKS}
        records = HandRecords(
            names=tuple(f"hand {motion.hand}, frame {n}" for n in motion.frames[rows].tolist()),
            images=(origin.image,) * count,
            sides=(motion.side,) * count,
            verdicts=("doubtful",) * count,
            reasons=((BRIDGED,),) * count,
            landmarks_3d=points,
            landmarks_2d=pixels[..., :2] / pixels[..., 2:],
            joint_angles_degrees=np.rad2deg(motion.joint_angles[rows]),
            shape=np.tile(motion.shape, (count, 1)),
            root_rotation=motion.root_rotation[rows],
            translation=motion.translation[rows],
            intrinsics=np.tile(camera, (count, 1, 1)),
            cameras=(origin.camera,) * count,
            image_sizes=(origin.image_size,) * count,
            loss={},
            sources=(origin.source,) * count,
            hand_models=(origin.hand_model,) * count,
            versions=(__version__,) * count,
            moments=tuple(
                Moment(motion.hand, int(motion.frames[row]), float(motion.times[row]), seen=False)
                for row in rows.tolist()
            ),
            **nothing,
        )
        return records, posed.vertices.double().numpy() * sign
