"""A second camera that looks at hands from their side."""

import torch

from depth.sets import SecondCamera
from hand_recon.camera import project

ROTATION = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]], dtype=torch.float64)
"""From the first camera's frame to that of a camera that looks along its x axis."""


def second(points: torch.Tensor) -> SecondCamera:
    """A camera beside the hands that sees them exactly."""
    K = torch.tensor([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]], dtype=torch.float64)
    translation = torch.tensor([-0.5, 0.0, 0.7], dtype=torch.float64)
    seen = project(points @ ROTATION.mT + translation, K.expand(len(points), 3, 3))
    return SecondCamera(seen, K, ROTATION, translation)
