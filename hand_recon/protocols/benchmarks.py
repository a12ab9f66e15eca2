"""File conventions and scores of each benchmark (Sec. 4.1).

The facts are from the benchmarks' own documentation and scripts: github.com/lmb-freiburg/freihand,
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
"""Metres per unit, by the unit's name."""

AXES: Final[Mapping[str, tuple[float, float, float]]] = {
    "OpenCV": (1.0, 1.0, 1.0),
    "OpenGL": (1.0, -1.0, -1.0),
}
"""Signs that convert a camera's axes to OpenCV's (x right, y down, z forward), and back."""

NOT_MEASURED: Final = -1.0
"""Score that FreiHAND's script writes for a mesh that it cannot compare."""


@dataclass(frozen=True)
class Protocol:
    """A benchmark's file conventions and its scores."""

    name: str
    """Name, as in `protocol=`."""
    order: str
    """Order of the landmarks in its files, a key of `hand_recon.hand.skeleton.LANDMARK_ORDERS`."""
    axes: str
    """Camera axes of its files, a key of `AXES`."""
    unit: str
    """Unit of its files, a key of `UNITS`."""
    frames: int | None
    """Number of hands in the official test set; none where it depends on the split."""
    decimals: int
    """Decimal places that are written; `submission.py` has the effect of rounding."""
    score: Callable[[HandPoints, HandPoints], dict[str, Any]]
    """Official scores of ground truth and prediction, both in FreiHAND's order, OpenCV's axes and metres."""
    scores_vertices: bool = True
    """True if the vertices are scored as well."""
    is_text: bool = False
    """True if its files are text, one line of an id and 63 numbers per hand (DexYCB's), rather than JSON."""

    def to_internal(self, points: HandPoints) -> HandPoints:
        """Convert from the file's conventions to FreiHAND's order, OpenCV's axes and metres."""
        order = list(landmark_permutation(self.order, "freihand"))
        return self._moved(points, order, UNITS[self.unit])

    def from_internal(self, points: HandPoints) -> HandPoints:
        """Convert from FreiHAND's order, OpenCV's axes and metres to the file's conventions."""
        order = list(landmark_permutation("freihand", self.order))
        return self._moved(points, order, 1 / UNITS[self.unit])

    def scores(self, ground_truth: HandPoints, prediction: HandPoints) -> dict[str, Any]:
        """Scores of the official script, under its names and in its units.

        Args:
            ground_truth: Points in FreiHAND's order, OpenCV's axes and metres.
            prediction: The same hands; its vertices correspond to the ground truth's.

        Returns:
            Every score; those of the vertices are −1 where either side has none.

        Raises:
            ValueError: The numbers of vertices differ.
        """
        if not self.scores_vertices:
            return self.score(ground_truth, prediction)
        if ground_truth.vertices is not None and prediction.vertices is not None:
            return self.score(ground_truth, prediction)
        # The official function always scores some surface: give it the landmarks, and drop their scores.
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
        if factor == 1 and self.axes == "OpenCV":
            return points
        return points * (points.new_tensor(AXES[self.axes]) * factor)


PROTOCOLS: Final[Mapping[str, Protocol]] = {
    protocol.name: protocol
    for protocol in (
        Protocol("freihand", "freihand", "OpenCV", "m", 3960, 5, freihand_scores),
        Protocol("ho3d_v2", "ho3d", "OpenGL", "m", 11524, 4, ho3d_scores),
        Protocol("ho3d_v3", "ho3d", "OpenGL", "m", 20137, 4, ho3d_scores),
        *(
            Protocol(
                name,
                "freihand",
                "OpenCV",
                "mm",
                None,
                2,
                dexycb_scores,
                scores_vertices=False,
                is_text=True,
            )
            for name in ("dexycb", "dexycb_s0", "dexycb_s1", "dexycb_s2", "dexycb_s3")
        ),
    )
}
"""Every protocol by name. DexYCB's splits share their metric and file conventions."""


def protocol_named(name: str) -> Protocol:
    """Look up a protocol by name.

    Raises:
        ValueError: There is no protocol of that name.
    """
    if name not in PROTOCOLS:
        raise ValueError(f"Unknown protocol {name!r}; known are {', '.join(PROTOCOLS)}.")
    return PROTOCOLS[name]


def report_scores(
    scores: Mapping[str, Any], proper_error: float, unaligned: tuple[float, float]
) -> dict[str, float]:
    """Convert official scores to the paper's names and units.

    Args:
        scores: Official scores, as `Protocol.scores` returns them.
        proper_error: E_J without reflections, millimetres; left out where it equals E_J.
        unaligned: E_J without alignment and relative to the wrist, millimetres.

    Returns:
        Errors in millimetres, areas and F-scores 0 to 1; vertex scores are absent where not measured.
    """
    if "procrustes" in scores:
        renamed = {"E_J": scores["procrustes"]["mpjpe_mm"], "AUC_J": scores["procrustes"]["auc"]}
    else:
        kind = "xyz_al" if "xyz_al_mean3d" in scores else "xyz_procrustes_al"
        renamed = {"E_J": 10 * scores[f"{kind}_mean3d"], "AUC_J": scores[f"{kind}_auc3d"]}
        if scores["mesh_al_mean3d"] != NOT_MEASURED:
            renamed["E_V"] = 10 * scores["mesh_al_mean3d"]
            renamed["AUC_V"] = scores["mesh_al_auc3d"]
            renamed["F@5"], renamed["F@15"] = scores["f_al_score_5"], scores["f_al_score_15"]
    if not torch.isclose(torch.tensor(proper_error), torch.tensor(renamed["E_J"]), rtol=1e-4):
        renamed["E_J_proper"] = proper_error
    renamed["E_J_unaligned"], renamed["MPJPE"] = unaligned
    return renamed


def _landmarks_as_surface(points: HandPoints) -> HandPoints:
    return HandPoints(points.landmarks, points.landmarks)
