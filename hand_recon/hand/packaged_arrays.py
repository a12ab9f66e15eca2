"""Reads the arrays that the package carries as npz files."""

from importlib.resources import files

import numpy as np
import torch
from torch import Tensor


def packaged_arrays(package: str, name: str, *, what: str, rebuild: str) -> dict[str, Tensor]:
    """Read all arrays of an npz file of the package.

    Args:
        package: Package that the file is in, such as `hand_recon.hand`.
        name: Path of the file from there.
        what: Content of the file, for the message.
        rebuild: Command that makes the file again, for the message.

    Raises:
        FileNotFoundError: The file is missing from the package.
    """
    path = files(package) / name
    if not path.is_file():
        raise FileNotFoundError(
            f"No {what} at {path}. This file is part of the repository: restore it with git, or make it "
            f"again with {rebuild}."
        )
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        return {key: torch.from_numpy(archive[key]) for key in archive.files}
