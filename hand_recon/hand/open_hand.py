"""The licence-free hand: derived from MakeHuman's CC0 data, read from a small asset in the package."""

from importlib.resources import files

import numpy as np
import torch

from hand_recon.hand.model import HandAsset, HandModel

ASSET = "assets/open_hand.npz"
"""Built by `tools/build_open_hand.py`; `assets/NOTICE.md` tells its origin."""

MANO_LABELLED = ("freihand", "dexycb", "ho3d")
"""Datasets whose landmarks the set `mano` stands for, as near as a hand that is not MANO can come.

They differ by a few millimetres at the fingertips, in the numbers of MANO's vertices; this hand has others.
"""


def load_open_hand() -> HandAsset:
    """Read the open hand.

    Raises:
        FileNotFoundError: The asset is not beside this module.
    """
    path = files("hand_recon.hand") / ASSET
    if not path.is_file():
        raise FileNotFoundError(
            f"No open hand at {path}. It is part of the repository: restore it with git, or rebuild "
            "it with `make asset` (needs the `assets` extra)."
        )
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        arrays = {name: torch.from_numpy(archive[name]) for name in archive.files}
    regressors = {
        name.removeprefix("landmarks_"): arrays.pop(name).float()
        for name in list(arrays)
        if name.startswith("landmarks_")
    }
    regressors |= dict.fromkeys(MANO_LABELLED, regressors["mano"])
    integers = {name: arrays.pop(name).long() for name in ("faces", "wrist_ring")}
    floats = {name: array.float() for name, array in arrays.items()}
    return HandAsset(name="open", landmark_regressors=regressors, **integers, **floats)


def open_hand(landmarks: str = "knuckle") -> HandModel:
    """The open hand's model with the named landmark set: `knuckle`, or `mano` by any of its names."""
    return HandModel(load_open_hand(), landmarks)
