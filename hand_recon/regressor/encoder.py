"""Interface of the encoders: a batch in, features out (Sec. 4.1)."""

from abc import ABC, abstractmethod

from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.schema import HandBatch


class Encoder(nn.Module, ABC):
    """Base class of encoders."""

    feature_size: int
    """Number of features."""

    def shown(self, batch: HandBatch) -> HandBatch:
        """The batch as the network sees it; an encoder may leave out some of its input in training."""
        return batch

    @abstractmethod
    def forward(self, batch: HandBatch) -> Float[Tensor, "batch feature"]:
        """Features of every hand of a batch."""
