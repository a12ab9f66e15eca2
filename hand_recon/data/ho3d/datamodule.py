"""Lightning datamodule of HO3D (Sec. 4.1)."""

from hand_recon.data.crop import CropPolicy
from hand_recon.data.ho3d.dataset import Ho3d, Ho3dRecipe
from hand_recon.data.image_datamodule import ImageDataModule
from hand_recon.data.selection import evenly_spaced
from hand_recon.schema import HandParameters


class Ho3dDataModule(ImageDataModule):
    """Real right hands in HO3D's layout; see `Ho3dRecipe` for the options."""

    name = "ho3d"
    landmark_set = "ho3d"
    recipe_type = Ho3dRecipe
    dataset_type = Ho3d
    default_crop = CropPolicy(around="joints")

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        """Pose and shape of the training hands, through the user's MANO; None without it."""
        dataset = self.dataset("train")
        hands = dataset.mano_hands() if isinstance(dataset, Ho3d) else None
        if hands is None or not isinstance(dataset, Ho3d):
            return None
        chosen = evenly_spaced(len(dataset), limit or len(dataset))
        return hands.parameters(dataset.rows[chosen])
