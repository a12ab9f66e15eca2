"""The open hand: a licence-free hand model from MakeHuman's CC0 data, stored as an asset in the package."""

from importlib.resources import files

from hand_recon.hand.landmark_offsets import with_offsets
from hand_recon.hand.model import HandAsset, HandModel
from hand_recon.hand.packaged_arrays import packaged_arrays

ASSET = "assets/open_hand.npz"
"""The asset, built by `tools/build_open_hand.py`; `assets/NOTICE.md` gives its origin."""

DETECTOR_LANDMARKS = "assets/mediapipe_landmarks.npz"
"""`offsets` (21 × 3, metres): where MediaPipe puts the landmarks, from the set `knuckle`, fixed to the bones.

Learnt from 2D landmarks of photographs by `tools/learn_from_landmarks.py`; `assets/NOTICE.md` has the origin.
"""

MANO_LABELLED = ("freihand", "dexycb", "ho3d")
"""Datasets labelled with MANO, for which the open hand approximates the landmarks by its set `mano`.

Their landmarks differ by a few millimetres at the fingertips, which are vertices of MANO's mesh; the open
hand has another mesh.
"""


def load_open_hand() -> HandAsset:
    """Read the open hand's asset.

    Raises:
        FileNotFoundError: The asset is missing from the package.
    """
    arrays = packaged_arrays(
        "hand_recon.hand",
        ASSET,
        what="open hand",
        rebuild="`make asset` (needs the `assets` extra)",
    )
    regressors = {
        name.removeprefix("landmarks_"): arrays.pop(name).float()
        for name in list(arrays)
        if name.startswith("landmarks_")
    }
    regressors |= dict.fromkeys(MANO_LABELLED, regressors["mano"])
    integers = {name: arrays.pop(name).long() for name in ("faces", "wrist_ring")}
    floats = {name: array.float() for name, array in arrays.items()}
    asset = HandAsset(name="open", landmark_regressors=regressors, **integers, **floats)
    _add_detector_landmarks(asset)
    return asset


def _add_detector_landmarks(asset: HandAsset) -> None:
    """Add the landmark set `mediapipe` to an asset that has `knuckle`."""
    package, command = "hand_recon.hand", "`python -m tools.learn_from_landmarks`"
    # The command reads the hand without these landmarks, too.
    if (files(package) / DETECTOR_LANDMARKS).is_file():
        arrays = packaged_arrays(
            package, DETECTOR_LANDMARKS, what="detector's landmarks", rebuild=command
        )
        knuckle = asset.landmark_regressors["knuckle"]
        asset.landmark_regressors["mediapipe"] = with_offsets(asset, knuckle, arrays["offsets"])


def open_hand(landmark_set: str = "knuckle") -> HandModel:
    """Build the open hand with a landmark set.

    Args:
        landmark_set: `knuckle` (rotation centres, as people mark them), `mediapipe` (as the detector marks
            them), or `mano` or one of `MANO_LABELLED`.
    """
    return HandModel(load_open_hand(), landmark_set)
