"""What each benchmark expects of a file of predictions, and what it scores (Sec. 4.1).

Facts are from the benchmarks' own documentation and scripts: github.com/lmb-freiburg/freihand,
github.com/shreyashampali/ho3d and github.com/NVlabs/dex-ycb-toolkit.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.evaluation.scores import HandPoints
from hand_recon.hand.skeleton import landmark_permutation
from hand_recon.protocols.official import dexycb_scores, freihand_scores, ho3d_scores

UNITS: Final[Mapping[str, float]] = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Metres per unit."""

AXES: Final[Mapping[str, tuple[float, float, float]]] = {
    "OpenCV": (1.0, 1.0, 1.0),
    "OpenGL": (1.0, -1.0, -1.0),
}
"""Signs that take a camera's axes to OpenCV's: x right, y down, z forward. Each is its own inverse."""

NOT_MEASURED: Final = -1.0
"""What FreiHAND's script writes for the errors of a mesh that it cannot compare."""


@dataclass(frozen=True)
class Protocol:
    """A benchmark's form of files and its scores."""

    name: str
    """As in `protocol=`."""
    order: str
    """Order of the landmarks in its files, a key of `hand_recon.hand.skeleton.LANDMARK_ORDERS`."""
    axes: str
    """Of its camera, a key of `AXES`."""
    unit: str
    """Of its files, a key of `UNITS`."""
    frames: int | None
    """Hands of the official test set; none where it depends on the split."""
    decimals: int
    """Digits behind the point that are written; `submission.py` says what rounding costs."""
    score: Callable[[HandPoints, HandPoints], dict[str, Any]]
    """Of points in this project's form."""
    scores_vertices: bool = True
    """Whether there are scores of the surface."""

    def to_internal(self, points: HandPoints) -> HandPoints:
        """From a file's form to FreiHAND's order, OpenCV's axes and metres."""
        order = list(landmark_permutation(self.order, "freihand"))
        return self._moved(points, order, UNITS[self.unit])

    def from_internal(self, points: HandPoints) -> HandPoints:
        """From FreiHAND's order, OpenCV's axes and metres to a file's form."""
        order = list(landmark_permutation("freihand", self.order))
        return self._moved(points, order, 1 / UNITS[self.unit])

    def scores(self, ground_truth: HandPoints, prediction: HandPoints) -> dict[str, Any]:
        """What the official script computes, under its names and in its units.

        Args:
            ground_truth: In this project's form, metres.
            prediction: The same hands; its vertices correspond.

        Returns:
            Without vertices on either side, −1 for every score of the surface.

        Raises:
            ValueError: Vertices do not correspond.
        """
        if not self.scores_vertices:
            return self.score(ground_truth, prediction)
        if ground_truth.vertices is not None and prediction.vertices is not None:
            return self.score(ground_truth, prediction)
        # The official function scores some surface in any case; what it says of this one is dropped.
        scores = self.score(_landmarks_as_surface(ground_truth), _landmarks_as_surface(prediction))
        return {
            name: NOT_MEASURED if name.startswith(("mesh", "f_")) else value
            for name, value in scores.items()
        }

    def _moved(self, points: HandPoints, order: list[int], factor: float) -> HandPoints:
        vertices = None if points.vertices is None else self._scaled(points.vertices, factor)
        return HandPoints(self._scaled(points.landmarks[:, order], factor), vertices)

    def _scaled(
        self, points: Float[Tensor, "hand point 3"], factor: float
    ) -> Float[Tensor, "hand point 3"]:
        return points * (points.new_tensor(AXES[self.axes]) * factor)


PROTOCOLS: Final[Mapping[str, Protocol]] = {
    protocol.name: protocol
    for protocol in (
        Protocol("freihand", "freihand", "OpenCV", "m", 3960, 5, freihand_scores),
        Protocol("ho3d_v2", "ho3d", "OpenGL", "m", 11524, 4, ho3d_scores),
        Protocol("ho3d_v3", "ho3d", "OpenGL", "m", 20137, 4, ho3d_scores),
        *(
            Protocol(
                name, "freihand", "OpenCV", "mm", None, 2, dexycb_scores, scores_vertices=False
            )
            for name in ("dexycb", "dexycb_s0", "dexycb_s1", "dexycb_s2", "dexycb_s3")
        ),
    )
}
"""By name. DexYCB's splits share their metric and their form."""


def protocol_named(name: str) -> Protocol:
    """The protocol of that name.

    Raises:
        ValueError: There is none.
    """
    if name not in PROTOCOLS:
        raise ValueError(f"Unknown protocol {name!r}; known are {', '.join(PROTOCOLS)}.")
    return PROTOCOLS[name]


def report_scores(
    scores: Mapping[str, Any], proper_error: float, unaligned: tuple[float, float]
) -> dict[str, float]:
    """The paper's names and units for what the official script computed.

    Args:
        scores: As `Protocol.scores` returns them.
        proper_error: E_J without reflections, millimetres; left out where it is E_J.
        unaligned: E_J without alignment and relative to the wrist, millimetres.

    Returns:
        Errors in millimetres, areas and F-scores 0 to 1; surfaces that were not measured are absent.
    """
    if "procrustes" in scores:
        ours = {"E_J": scores["procrustes"]["mpjpe_mm"], "AUC_J": scores["procrustes"]["auc"]}
    else:
        kind = "xyz_al" if "xyz_al_mean3d" in scores else "xyz_procrustes_al"
        ours = {"E_J": 10 * scores[f"{kind}_mean3d"], "AUC_J": scores[f"{kind}_auc3d"]}
        if scores["mesh_al_mean3d"] != NOT_MEASURED:
            ours["E_V"] = 10 * scores["mesh_al_mean3d"]
            ours["AUC_V"] = scores["mesh_al_auc3d"]
            ours["F@5"], ours["F@15"] = scores["f_al_score_5"], scores["f_al_score_15"]
    if not torch.isclose(torch.tensor(proper_error), torch.tensor(ours["E_J"]), rtol=1e-4):
        ours["E_J_proper"] = proper_error
    ours["E_J_unaligned"], ours["MPJPE"] = unaligned
    return ours


def _landmarks_as_surface(points: HandPoints) -> HandPoints:
    return HandPoints(points.landmarks, points.landmarks)
