"""Lightning datamodule of DexYCB (Sec. 4.1)."""

import numpy as np
import torch

from hand_recon.data.dexycb.dataset import AROUND_JOINTS, DexYcb, DexYcbRecipe
from hand_recon.data.image_datamodule import ImageDataModule
from hand_recon.data.selection import evenly_spaced
from hand_recon.schema import HandParameters


class DexYcbDataModule(ImageDataModule):
    """Real right and left hands in DexYCB's layout; see `DexYcbRecipe` for the options."""

    name = "dexycb"
    landmark_set = "dexycb"
    recipe_type = DexYcbRecipe
    dataset_type = DexYcb
    default_crop = AROUND_JOINTS

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        """Pose and shape of the training hands, left ones mirrored, through MANO.

        Args:
            limit: At most so many hands, spread evenly over the set.

        Returns:
            None, with a warning, if MANO is missing.
        """
        data = self.dataset("train")
        surfaces = data.surfaces() if isinstance(data, DexYcb) else None
        if surfaces is None:
            return None
        rows = np.array(evenly_spaced(len(surfaces), limit or len(surfaces)))
        with torch.no_grad():
            return surfaces.select(rows).parameters()
