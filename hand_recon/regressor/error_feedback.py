"""The regressor: iterative error feedback from features to pose, shape, camera and σ (Sec. 3, 4.1)."""

from dataclasses import replace
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.camera import (
    REFERENCE_SIZE,
    bounded_log_scale,
    default_intrinsics,
    project,
    raw_to_translation,
    six_d_to_rotation,
    to_true_camera,
)
from hand_recon.hand.model import HandModel
from hand_recon.regressor.encoder import Encoder, Evidence
from hand_recon.schema import CropMotion, HandBatch, HandParameters, HandPrediction
from hand_recon.uncertainty import soft_bound

_SIZES: Final = {"joint_angles": 45, "root": 6, "camera": 3, "shape": 10, "log_sigma": 42}
STATE_SIZE: Final = sum(_SIZES.values())
"""Size of the state that the regressor refines: 45 + 6 + 3 + 10 + 42, plus 21 with correlations."""

_LOG_SIGMA: Final = slice(STATE_SIZE - _SIZES["log_sigma"], STATE_SIZE)
"""Position of log σ in the state."""

_FED_BACK: Final = STATE_SIZE - _SIZES["log_sigma"]
"""Size of the part of the state that is fed back: pose, root, camera and shape."""

_FEEDBACK_UNIT: Final = 20.0
"""Unit of the reprojection error, pixels of a 224-pixel crop; the size of the first round's errors."""

_FEEDBACK_LIMIT: Final = 10.0
"""Clip of the reprojection error in `_FEEDBACK_UNIT`s: ±200 px, so that outliers do not dominate."""


class Regressor(nn.Module):
    """Features → pose, shape, camera and log σ by three rounds of error feedback (Sec. 4.1).

    As in the authors' network, each round sees the features and the last estimate and predicts a correction
    through two linear layers. Unlike there, log σ is not fed back: in the squared-error stage, the network
    would use it as memory, with values from which no likelihood can start (decision 27). With landmarks as
    input, a round can also see the reprojection error of the last estimate, as in the original error
    feedback (Carreira et al., CVPR 2016).

    Args:
        encoder: Features of the input.
        hand: The hand model that turns parameters into a mesh.
        iterations: Rounds of feedback.
        width: Size of the two hidden layers.
        dropout: After each hidden layer.
        activation: Whether the hidden layers are non-linear; the authors' are not.
        use_intrinsics: Whether to use the batch's camera matrix, where it has one, in place of the constant
            focal length of Sec. 3.1.
        reprojection: Whether each round sees the reprojection error of the last one; for encoders that
            have landmarks.
        correlated: Whether to predict the correlation of each landmark's two coordinates (full covariance).

    Raises:
        ValueError: Reprojection errors are wanted, and the encoder has no landmarks to compare with.
    """

    initial_state: Tensor

    def __init__(
        self,
        encoder: Encoder,
        hand: HandModel,
        *,
        iterations: int = 3,
        width: int = 1024,
        dropout: float = 0.5,
        activation: bool = False,
        use_intrinsics: bool = False,
        reprojection: bool = False,
        correlated: bool = False,
    ) -> None:
        super().__init__()
        if reprojection and not encoder.has_landmarks:
            raise ValueError(
                "reprojection=true compares projections with landmarks, and this encoder has none. Use "
                "model.reprojection=false, or a model with landmarks: model=lifter or model=photos."
            )
        self.encoder = encoder
        self.hand = hand
        self.iterations = iterations
        self.use_intrinsics = use_intrinsics
        # Rounds need landmarks only, and without its surface a hand is posed several times faster.
        self.skeleton = hand.landmarks_only() if reprojection else None
        self.sizes = _SIZES | ({"correlation": 21} if correlated else {})
        initial = _initial_state()
        if correlated:
            initial = torch.cat([initial, torch.zeros(21)])
        self.regressor = nn.Sequential(
            nn.Linear(encoder.feature_size + _FED_BACK + (42 if reprojection else 0), width),
            nn.ReLU() if activation else nn.Identity(),
            nn.Dropout(dropout),
            nn.Linear(width, width),
            nn.ReLU() if activation else nn.Identity(),
            nn.Dropout(dropout),
        )
        self.decoders = nn.ModuleDict(
            {name: nn.Linear(width, size) for name, size in self.sizes.items()}
        )
        for name, parameter in self.decoders.named_parameters():
            # σ and its correlation keep their initial values, the same for every hand, until a likelihood
            # trains them; otherwise their values at the switch would be noise.
            if name.endswith("weight") and not name.startswith(("log_sigma", "correlation")):
                nn.init.xavier_uniform_(parameter, gain=0.01)
            else:
                nn.init.zeros_(parameter)
        self.register_buffer("initial_state", initial)

    def forward(self, batch: HandBatch) -> HandPrediction:
        """Reconstruct the hand in each crop.

        Args:
            batch: The batch, with images as floats 0–1. Labels are used by an encoder of landmarks only.
        """
        evidence: Evidence = self.encoder(batch)
        # Rotations and projections need full precision, so only the backbone uses mixed precision.
        with torch.autocast(device_type=evidence.features.device.type, enabled=False):
            state = self._feedback(evidence, batch)
            prediction = self._reconstruct(state, evidence.motion, batch)
        return replace(prediction, located_2d=evidence.located_2d)

    def place(self, batch: HandBatch) -> HandParameters:
        """Estimate the parameters of the hand in each crop, without posing its surface.

        Args:
            batch: As for `forward`.

        Returns:
            The parameters that `forward` returns, at a fraction of its time.
        """
        evidence: Evidence = self.encoder(batch)
        state = self._feedback(evidence, batch)
        return self._in_crop(state, evidence.motion, batch)[0]

    @torch.no_grad()
    def shift_log_sigma(self, by: Float[Tensor, "landmark=21 2"]) -> None:
        """Shift the initial log σ, and with it every prediction of log σ before the bounds.

        Args:
            by: Shift of each coordinate's log σ.
        """
        self.initial_state[_LOG_SIGMA] += by.flatten().to(self.initial_state)

    def _feedback(self, evidence: Evidence, batch: HandBatch) -> Tensor:
        features = evidence.features.float()
        state = self.initial_state.expand(features.shape[0], -1)
        for _ in range(self.iterations):
            seen = [features, state[:, :_FED_BACK]]
            if self.skeleton is not None:
                seen.append(self._reprojection_error(self.skeleton, state, evidence, batch))
            hidden = self.regressor(torch.cat(seen, dim=-1))
            correction = torch.cat([decoder(hidden) for decoder in self.decoders.values()], dim=-1)
            state = self._orthonormal(state + correction)
        return state

    def _orthonormal(self, state: Tensor) -> Tensor:
        """The same state with orthonormal columns of the rotation.

        Their lengths do not change the rotation, but they scale the effect of the next round's correction
        (decision 49).
        """
        parts = self._parts(state)
        parts["root"] = six_d_to_rotation(parts["root"])[..., :2].mT.flatten(-2)
        return torch.cat(list(parts.values()), dim=-1)

    def _reprojection_error(
        self, skeleton: HandModel, state: Tensor, evidence: Evidence, batch: HandBatch
    ) -> Float[Tensor, "batch coordinate=42"]:
        """Projection minus landmark, in `_FEEDBACK_UNIT`s, clipped; zero where no landmark is known."""
        assert evidence.landmarks_2d is not None and evidence.visible is not None  # noqa: S101, PT018
        intrinsics = batch.intrinsics if evidence.motion is None else None
        parameters, camera = self._placed(state, batch.crop_size, intrinsics)
        projected = project(skeleton.to_camera(parameters).landmarks, camera)
        error = (projected - evidence.landmarks_2d).masked_fill(~evidence.visible[..., None], 0.0)
        error = error * (REFERENCE_SIZE / batch.crop_size / _FEEDBACK_UNIT)
        return error.clamp(-_FEEDBACK_LIMIT, _FEEDBACK_LIMIT).flatten(1)

    def _placed(
        self, state: Tensor, crop_size: int, intrinsics: Tensor | None
    ) -> tuple[HandParameters, Float[Tensor, "batch 3 3"]]:
        """Hand parameters of a state, and the camera matrix that they belong to."""
        parts = self._parts(state)
        rotation = six_d_to_rotation(parts["root"])
        scale = bounded_log_scale(parts["camera"][..., :1])
        translation = raw_to_translation(torch.cat([scale, parts["camera"][..., 1:]], dim=-1))
        camera = default_intrinsics(crop_size, state).expand(state.shape[0], 3, 3)
        if self.use_intrinsics and intrinsics is not None:
            camera = intrinsics
            rotation, translation = to_true_camera(rotation, translation, camera, crop_size)
        joint_angles = parts["joint_angles"].unflatten(-1, (15, 3))
        return HandParameters(joint_angles, parts["shape"], rotation, translation), camera

    def _in_crop(
        self, state: Tensor, motion: CropMotion | None, batch: HandBatch
    ) -> tuple[HandParameters, Float[Tensor, "batch 3 3"]]:
        """Hand parameters of a state in the camera of the crop, and its matrix."""
        if motion is None:
            return self._placed(state, batch.crop_size, batch.intrinsics)
        upright, _ = self._placed(state, batch.crop_size, None)
        camera = default_intrinsics(batch.crop_size, state).expand(state.shape[0], 3, 3)
        if self.use_intrinsics and batch.intrinsics is not None:
            camera = batch.intrinsics
        return in_camera(upright, motion, camera, batch.crop_size), camera

    def _reconstruct(
        self, state: Tensor, motion: CropMotion | None, batch: HandBatch
    ) -> HandPrediction:
        parts = self._parts(state)
        parameters, camera = self._in_crop(state, motion, batch)
        hand = self.hand.to_camera(parameters)
        correlation = parts.get("correlation")
        return HandPrediction(
            parameters=parameters,
            vertices=hand.vertices,
            joints=hand.joints,
            landmarks_3d=hand.landmarks,
            landmarks_2d=project(hand.landmarks, camera),
            log_sigma=soft_bound(parts["log_sigma"].unflatten(-1, (21, 2))),
            intrinsics=camera,
            # Short of ±1, where a covariance has no inverse.
            correlation=None if correlation is None else 0.99 * correlation.tanh(),
        )

    def _parts(self, state: Tensor) -> dict[str, Tensor]:
        return dict(zip(self.sizes, state.split(list(self.sizes.values()), dim=-1), strict=True))


def in_camera(
    upright: HandParameters,
    motion: CropMotion,
    intrinsics: Float[Tensor, "hand 3 3"],
    crop_size: int,
) -> HandParameters:
    """Convert parameters of upright crops to the camera of the crops.

    Args:
        upright: Parameters in the default camera of an upright crop.
        motion: Transforms from the crops to the upright ones.
        intrinsics: Camera matrices of the crops, pixels.
        crop_size: Side of an upright crop, pixels.
    """
    # The camera of the crop after the roll about its axis that makes the hand upright.
    back = motion.camera.mT
    camera = motion.pixels @ intrinsics @ back
    rotation, translation = to_true_camera(
        upright.root_rotation, upright.translation, camera, crop_size
    )
    return HandParameters(
        upright.joint_angles,
        upright.shape,
        back @ rotation,
        (back @ translation[..., None])[..., 0],
    )


def _initial_state() -> Float[Tensor, " state"]:
    """Initial state: a slightly bent hand, upright, that fills two thirds of the crop.

    The authors' starting values are not public; these follow from the camera (decision 6).
    """
    angles = torch.zeros(15, 3)
    angles[:, 0] = 0.3
    # Columns of a rotation that points the fingers (−x) up and shows the palm (−y) to the camera.
    root = torch.tensor([0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    camera = torch.tensor([6.7, 0.0, 0.0])
    log_sigma = torch.full((42,), 1.5)
    return torch.cat([angles.flatten(), root, camera, torch.zeros(10), log_sigma])
