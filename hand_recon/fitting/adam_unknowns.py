"""The unknowns of a fit by Adam (Sec. 3.4)."""

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.camera import project, six_d_to_rotation
from hand_recon.fitting.adam import Adam
from hand_recon.fitting.start import SHALLOWEST, Start
from hand_recon.schema import HandParameters


class AdamUnknowns:
    """The optimized numbers of each hand, scaled so that one learning rate suits all of them."""

    def __init__(self, start: Start, intrinsics: Float[Tensor, "hand 3 3"]) -> None:
        """Take a start of every hand.

        Args:
            start: The starts, one per hand.
            intrinsics: Camera matrices, pixels.
        """
        pixel = project(start.translation[:, None], intrinsics)[:, 0]
        depth = start.translation[:, 2].clamp(min=SHALLOWEST)
        self.values = {
            "joint_angles": start.joint_angles,
            "columns": start.root_rotation[..., :2].mT.flatten(-2),
            "shape": start.shape,
            # The projected origin in hundreds of pixels: a step of 0.05 is five pixels.
            "origin": pixel / 100,
            "log_depth": depth.log(),
        }
        self._require_gradients()

    def _require_gradients(self) -> None:
        self.values = {
            name: value.detach().clone().requires_grad_() for name, value in self.values.items()
        }

    def keep(self, rows: Tensor) -> None:
        """Keep the rows with these indices, and drop the others.

        Args:
            rows: Indices of hands.
        """
        self.values = {name: value[rows] for name, value in self.values.items()}
        self._require_gradients()

    def optimizer(self) -> Adam:
        """Adam over all numbers; the translation has 0.6 of the learning rate."""
        shares = [0.6 if name in ("origin", "log_depth") else 1.0 for name in self.values]
        return Adam(list(self.values.values()), shares, betas=(0.9, 0.99))

    def parameters(self, intrinsics: Float[Tensor, "hand 3 3"]) -> HandParameters:
        """The parameters of the hands.

        Args:
            intrinsics: Camera matrices, pixels.
        """
        values = self.values
        one = torch.ones_like(values["log_depth"])[:, None]
        pixel = torch.cat([values["origin"] * 100, one], dim=-1)
        rays = torch.linalg.solve(intrinsics, pixel[..., None])[..., 0]
        return HandParameters(
            values["joint_angles"],
            values["shape"],
            six_d_to_rotation(values["columns"]),
            rays * values["log_depth"].exp().clamp(min=SHALLOWEST)[:, None],
        )
