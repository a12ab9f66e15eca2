"""Adam by torch's functional form, with a learning rate per tensor.

The class `torch.optim.Adam` does the same steps, but imports torch's compiler when it is constructed: 1.3
seconds, a third of what fitting one hand takes.
"""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.optim.adam import adam


class Adam:
    """Adam without weight decay, in place.

    Args:
        values: What is optimized: leaf tensors.
        shares: Factor of the learning rate for each of them.
        betas: Decay of the running means of gradients and of their squares.
    """

    def __init__(
        self, values: Sequence[Tensor], shares: Sequence[float], betas: tuple[float, float]
    ) -> None:
        self.values, self.shares, self.betas = values, shares, betas
        self._means = [torch.zeros_like(value) for value in values]
        self._squares = [torch.zeros_like(value) for value in values]
        self._steps = [torch.zeros(()) for _ in values]

    @torch.no_grad()
    def step(self, gradients: Sequence[Tensor], learning_rate: float) -> None:
        """Change the values by one step.

        Args:
            gradients: One per value.
            learning_rate: Before the shares.
        """
        for index, share in enumerate(self.shares):
            at = slice(index, index + 1)
            adam(
                list(self.values[at]), list(gradients[at]), self._means[at], self._squares[at], [],
                self._steps[at], foreach=False, fused=False, amsgrad=False, beta1=self.betas[0],
                beta2=self.betas[1], lr=learning_rate * share, weight_decay=0.0, eps=1e-8, maximize=False,
            )  # fmt: skip
