"""Features of images from a backbone (Sec. 4.1)."""

from torch import Tensor, nn

from hand_recon.regressor.backbones import build_backbone
from hand_recon.regressor.encoder import Encoder, Evidence
from hand_recon.schema import HandBatch


class ImageEncoder(Encoder):
    """A backbone without its classifier, and the mean of its last features.

    Args:
        backbone: Name of the backbone, as for `build_backbone`.
        weights: `imagenet`, `none`, or the path of a state dict in the layout of the name's package.
        grid: Cells per side of the grid over which features are averaged. 1 is the paper's average pool;
        2 or
            more keep spatial information, which a small network trained from scratch needs (decision 19).
        frozen: Number of leading layers that keep their weights in training.

    Raises:
        ValueError: The backbone is unknown.
        RuntimeError: The ImageNet weights cannot be downloaded.
        FileNotFoundError: The file of weights does not exist.
    """

    def __init__(
        self,
        backbone: str = "resnet50",
        weights: str = "imagenet",
        grid: int = 1,
        *,
        frozen: int = 0,
    ) -> None:
        super().__init__()
        self.backbone = build_backbone(backbone, weights, frozen)
        self.pool = nn.AdaptiveAvgPool2d(grid)
        self.feature_size = self.backbone.channels[32] * grid * grid

    def forward(self, batch: HandBatch) -> Evidence:
        """Evidence from the batch's images, floats 0–1; nothing else of the batch is used.

        Raises:
            ValueError: There are no images.
        """
        if not batch.image.numel():
            raise ValueError(
                "This model needs images, and these data have landmarks alone. Use model=lifter with "
                "them, or data with images."
            )
        features: Tensor = self.pool(self.backbone(batch.image)[32]).flatten(1)
        return Evidence(features)
