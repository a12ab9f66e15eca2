"""One frame's annotation of HO3D (`meta/*.pkl`), read without unpickling it."""

from dataclasses import replace
from pathlib import Path

import torch

from hand_recon.data.ho3d.metas import read_meta
from hand_recon.hand.skeleton import landmark_permutation
from hand_recon.plausibility.given_hands import GivenHands, of_points
from hand_recon.runs.audit.mano import ManoReader, mano_pose


def read_meta_hand(path: Path, mano: ManoReader | None) -> GivenHands:
    """The hand of an annotation: its angles with MANO, else its landmarks.

    Args:
        path: The file.
        mano: The user's MANO; None without.

    Raises:
        RefusedMetaError: The file names more than arrays need, or is no annotation.
    """
    meta = read_meta(path)
    name = f"{path.parent.parent.name}/{path.stem}"
    if mano is not None and "handPose" in meta:
        pose, shape = meta.numbers("handPose", (48,)), meta.numbers("handBeta", (10,))
        if pose is not None and shape is not None:
            found = mano_pose(torch.from_numpy(pose)[None], torch.from_numpy(shape)[None])
            return mano.hands(found, str(path), ("right",), (name,))
    points = meta.numbers("handJoints3D", (21, 3))
    if points is None:
        return replace(of_points(torch.full((1, 21, 3), torch.nan), str(path)), names=(name,))
    ordered = torch.from_numpy(points)[None, list(landmark_permutation("ho3d", "freihand"))]
    return of_points(ordered, str(path), names=(name,), left=(False,), sides=("right",))
