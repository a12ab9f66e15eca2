"""Random hands in double precision for the tests of the second-order fit."""

import copy

import torch

from hand_recon.camera import default_intrinsics
from hand_recon.fitting.second_order.unknowns import Unknowns
from hand_recon.hand.axis_angle import axis_angle_to_rotation
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand


def double_hand(landmark_set: str = "knuckle") -> HandModel:
    """The open hand in double precision."""
    return copy.deepcopy(open_hand(landmark_set)).double()


def random_unknowns(count: int) -> Unknowns:
    """Hands of random pose, shape and rotation, half a metre away."""
    angles = 0.4 * torch.randn(count, 15, 3, dtype=torch.float64)
    rotation = axis_angle_to_rotation(torch.randn(count, 3, dtype=torch.float64))
    place = torch.tensor([100.0, 120.0, -0.7], dtype=torch.float64)
    place = place + 0.1 * torch.randn(count, 3, dtype=torch.float64)
    return Unknowns(angles, rotation, place, torch.randn(count, 10, dtype=torch.float64))


def random_cameras(count: int) -> torch.Tensor:
    """Camera matrices with two focal lengths and skew, pixels."""
    matrices = default_intrinsics(224, torch.zeros(1, dtype=torch.float64)).repeat(count, 1, 1)
    matrices[:, 0, 1] = 3.0
    matrices[:, 1, 1] *= 1.1
    return matrices
