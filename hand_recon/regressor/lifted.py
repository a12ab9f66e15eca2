"""Start of a network for photographs from a trained lifter, which knows poses that the photographs lack."""

import torch
from torch import Tensor

from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.photo_encoder import PhotoEncoder


def start_from_lifter(regressor: Regressor, lifter: Regressor) -> None:
    """Copy a lifter's weights; inputs that the lifter does not have start without effect.

    Before training, the network then lifts the landmarks that it finds, or is given, as the lifter does.

    Args:
        regressor: Network with a `PhotoEncoder`.
        lifter: Trained network with a `LandmarkEncoder` and hidden layers of the same sizes.

    Raises:
        ValueError: The network has another encoder, or its layers have other sizes than the lifter's.
    """
    encoder = regressor.encoder
    if not isinstance(encoder, PhotoEncoder) or not isinstance(lifter.encoder, LandmarkEncoder):
        raise ValueError(
            f"start_from={type(lifter.encoder).__name__} cannot start a network with the encoder "
            f"{type(encoder).__name__}. Use model=photos with a lifter, or start_from=none."
        )
    own, given = regressor.state_dict(), lifter.state_dict()
    features, extra = (
        lifter.encoder.feature_size,
        encoder.feature_size - lifter.encoder.feature_size,
    )
    started: dict[str, Tensor] = {}
    for name, value in given.items():
        if name.startswith(("hand.", "skeleton.")):
            continue
        ours = (
            name.replace("encoder.", "encoder.landmarks.", 1)
            if name.startswith("encoder.")
            else name
        )
        if name == "regressor.0.weight":
            value = _widened(value, features, extra)
        if ours not in own or own[ours].shape != value.shape:
            raise ValueError(
                f"The lifter's {name} has the shape {tuple(value.shape)}, and the network has "
                f"{tuple(own[ours].shape) if ours in own else 'none'}. Give model.width and "
                "model.encoder.landmarks.width and depth the lifter's values, or use start_from=none."
            )
        started[ours] = value
    regressor.load_state_dict(own | started)


def _widened(weight: Tensor, at: int, by: int) -> Tensor:
    """A weight matrix with `by` more inputs, without effect, before its input number `at`."""
    return torch.cat([weight[:, :at], weight.new_zeros(len(weight), by), weight[:, at:]], dim=1)
