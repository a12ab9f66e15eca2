"""Monocular 3D hand reconstruction that learns from 2D landmarks alone (ECCV 2024).

Names for use in other programs, imported when they are first used:

    hands = hand_recon.reconstruct("photo.jpg")                  # a photograph in, 3D hands out
    hands = hand_recon.fit_landmarks(points, side="left")       # 2D landmarks in, 3D hands out
    prior = hand_recon.Prior.default(hand_recon.open_hand())    # Eq. 5 in a training loop of your own
"""

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from hand_recon.data.landmarks.files import read_landmarks
    from hand_recon.evaluation.calibration import Calibration
    from hand_recon.evaluation.landmarks_2d import Landmarks2D
    from hand_recon.evaluation.metrics import HandMetrics
    from hand_recon.evaluation.plausibility import Plausibility
    from hand_recon.evaluation.scores import HandPoints
    from hand_recon.fitting.hands_file import read_hands
    from hand_recon.hand.open_hand import open_hand
    from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
    from hand_recon.knowledge.penetration.non_penetration import NonPenetration
    from hand_recon.knowledge.prior import Prior
    from hand_recon.knowledge.range_of_motion import range_of_motion_loss
    from hand_recon.knowledge.ranges import load_ranges
    from hand_recon.runs.fit_landmarks import fit_landmarks
    from hand_recon.runs.reconstruct import reconstruct
    from hand_recon.schema import HandParameters

__version__ = "0.2.0"

__all__ = [  # noqa: RUF022  # by what people do
    "reconstruct", "fit_landmarks", "read_landmarks", "read_hands",
    "open_hand", "HandParameters",
    "Prior", "range_of_motion_loss", "load_ranges", "FunctionalAnatomy", "NonPenetration",
    "HandMetrics", "HandPoints", "Landmarks2D", "Plausibility", "Calibration",
]  # fmt: skip

_MODULES: Final = {
    "Calibration": "evaluation.calibration",
    "FunctionalAnatomy": "knowledge.functional_anatomy",
    "HandMetrics": "evaluation.metrics",
    "HandParameters": "schema",
    "HandPoints": "evaluation.scores",
    "Landmarks2D": "evaluation.landmarks_2d",
    "NonPenetration": "knowledge.penetration.non_penetration",
    "Plausibility": "evaluation.plausibility",
    "Prior": "knowledge.prior",
    "fit_landmarks": "runs.fit_landmarks",
    "load_ranges": "knowledge.ranges",
    "open_hand": "hand.open_hand",
    "range_of_motion_loss": "knowledge.range_of_motion",
    "read_hands": "fitting.hands_file",
    "read_landmarks": "data.landmarks.files",
    "reconstruct": "runs.reconstruct",
}
"""Module of each public name: importing the package alone must not import torch."""


def __getattr__(name: str) -> Any:  # noqa: ANN401  # any public name
    if name not in _MODULES:
        raise AttributeError(f"module 'hand_recon' has no attribute {name!r}")
    found = getattr(importlib.import_module(f"hand_recon.{_MODULES[name]}"), name)
    # A module of the same name, such as runs.fit_landmarks, is never in the package's own namespace.
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
