"""A small network for photographs and hands in memory for the training on one GPU."""

import torch

from gpu.resident import ResidentHands
from gpu.rows import VIEW, module_of_row
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.training.module import HandReconstruction
from tests.support.views import known_hands, views

SIZE = 64
"""Side of the images, pixels."""


def network(hand: HandModel) -> Regressor:
    """A small network for photographs."""
    encoder = PhotoEncoder(
        "mobilenet_v3_small", "none", landmarks=LandmarkEncoder(16, 1, 0.1), width=8, view=VIEW
    )
    return Regressor(encoder, hand, width=16, dropout=0.0, activation=True, reprojection=True)


def module_of(row: int = 5, *, learning_rate: float = 1e-3) -> HandReconstruction:
    """The module of a row of Table 1 with the small network, the same at each call."""
    torch.manual_seed(0)
    return module_of_row(row, network(open_hand()), learning_rate=learning_rate, on_gpu=True)


def resident(hand: HandModel, count: int, folders: tuple[str, ...] = ("a", "b")) -> ResidentHands:
    """Hands in images of noise, with labels in crops of `SIZE` pixels and 3D."""
    batch = views(hand, known_hands(hand, count))
    labels = batch.landmarks_2d * SIZE / 224
    images = torch.randint(1, 256, (count, 3, SIZE, SIZE), dtype=torch.uint8)
    names = tuple(f"{folders[number % len(folders)]}/{number}.jpg" for number in range(count))
    return ResidentHands(images, labels, batch.labelled, names, batch.landmarks_3d)
