"""Lightning datamodule of FreiHAND (Sec. 4.1)."""

from pathlib import Path
from typing import Any

import torch

from hand_recon.data.freihand.dataset import FreiHand
from hand_recon.data.freihand.splits import FreiHandRecipe, training_mano
from hand_recon.data.image_datamodule import ImageDataModule
from hand_recon.data.selection import evenly_spaced
from hand_recon.hand.mano.labels import freihand_parameters
from hand_recon.hand.mano.layer import ManoLayer
from hand_recon.schema import HandParameters


class FreiHandDataModule(ImageDataModule):
    """Real hands in FreiHAND's layout; see `FreiHandRecipe` for the options."""

    name = "freihand"
    landmark_set = "mano"
    recipe_type = FreiHandRecipe
    dataset_type = FreiHand

    def __init__(
        self,
        *location: Path | str,
        mano: Path | str | None = None,
        **options: Any,  # noqa: ANN401  # Those of `ImageDataModule`.
    ) -> None:
        """Store the settings; files are read on first use.

        Args:
            *location: The folder that holds `training_xyz.json`, unless it is given as `root`.
            mano: Folder of the user's MANO, used only by `train_parameters`.
            **options: Those of `ImageDataModule`, and fields of `FreiHandRecipe`.
        """
        self.mano = mano
        super().__init__(*location, **options)

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        """Pose and shape of the training hands, from `training_mano.json` and the user's own MANO.

        Raises:
            FileNotFoundError: There are labels, but MANO is missing.
        """
        found = None if self.mano is None else training_mano(self.recipe)
        if found is None or self.mano is None:
            return None
        labels, intrinsics = (torch.from_numpy(array).float() for array in found)
        chosen = evenly_spaced(len(labels), limit or len(labels))
        layer = ManoLayer.load(self.mano, landmark_set="mano")
        with torch.no_grad():
            return layer.hand_parameters(
                *freihand_parameters(layer, labels[chosen], intrinsics[chosen])
            )
