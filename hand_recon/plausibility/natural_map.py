"""Map of audited poses among natural ones, as the paper's Fig. 1 (a), by principal components."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.hand.skeleton import AXES
from hand_recon.plausibility.audit import Audit
from hand_recon.plausibility.given_hands import as_array

NATURAL: Final = 1000
"""Number of natural poses on the map."""

SHOWN: Final = 2000
"""Most audited poses on the map, evenly spaced among all."""


NOISE: Final = 3.0
"""Standard deviation that every angle has in the distance, degrees; hinges of natural poses have no splay."""


@dataclass(frozen=True)
class NaturalMap:
    """Two coordinates of natural and of audited poses, and their distances from the mean natural pose."""

    natural: Float[np.ndarray, "natural 2"]
    """Coordinates of natural poses, radians along the first two components."""
    audited: Float[np.ndarray, "hand 2"]
    """Coordinates of audited poses; NaN for hands without a pose."""
    natural_distance: Float[np.ndarray, " natural"]
    """Distance of natural poses from their mean, standard deviations of all angles together."""
    audited_distance: Float[np.ndarray, " hand"]
    """The same of audited poses; NaN for hands without a pose."""
    implausible: Bool[np.ndarray, " hand"]
    """Mask of the implausible hands."""
    explained: float
    """Share of the variance of both that the two components hold."""


def natural_map(audit: Audit) -> NaturalMap:
    """Principal components of natural and audited poses together, without twist, which points do not show.

    Args:
        audit: The audit.
    """
    axes = [AXES.index("bend"), AXES.index("splay")]
    random = np.random.default_rng(0)
    natural = np.stack([sample_pose(random)[:, axes].ravel() for _ in range(NATURAL)])
    audited = np.radians(
        as_array(audit.findings.angles)[..., axes].reshape(len(audit.verdicts), -1)
    )
    posed = np.isfinite(audited).all(axis=1)
    # Each of the two sets has half the weight, whatever their numbers are.
    mean = natural.mean(axis=0)
    centred = [natural - mean, (audited - mean)[posed]]
    scatter = sum((one.T @ one / max(1, len(one)) for one in centred), np.zeros((30, 30)))
    values, vectors = np.linalg.eigh(scatter)
    plane = vectors[:, ::-1][:, :2]
    share = float(values[-2:].sum() / values.sum())
    # One finger's error is a small part of a pose, and hardly moves it on the plane.
    covariance = np.cov(natural.T) + np.radians(NOISE) ** 2 * np.eye(natural.shape[1])
    root = np.linalg.cholesky(np.linalg.inv(covariance))
    distances = (np.linalg.norm((one - mean) @ root, axis=1) for one in (natural, audited))
    scale = natural.shape[1] ** 0.5
    inside, outside = (one / scale for one in distances)
    return NaturalMap(
        centred[0] @ plane,
        (audited - mean) @ plane,
        inside,
        outside,
        audit.implausible().numpy(),
        share,
    )


def draw_map(found: NaturalMap, path: Path) -> None:
    """Draw the map as a PNG.

    Args:
        found: The coordinates.
        path: The file.
    """
    # Half a second, which commands that draw no map should not wait for.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 5.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    natural, audited = np.degrees(found.natural), np.degrees(found.audited)
    grey = {"s": 8, "c": "#9aa7b5", "linewidths": 0}
    left.scatter(natural[:, 0], natural[:, 1], label=f"natural poses ({NATURAL})", **grey)
    right.scatter(natural[:, 0], found.natural_distance, **grey)
    step = max(1, len(audited) // SHOWN)
    for mask, colour, name in (
        (~found.implausible, "#2c7bb6", "audited, plausible"),
        (found.implausible, "#d7191c", "audited, implausible"),
    ):
        style = {"s": 16, "c": colour, "linewidths": 0}
        some, far = audited[mask][::step], found.audited_distance[mask][::step]
        left.scatter(some[:, 0], some[:, 1], label=f"{name} ({int(mask.sum())})", **style)
        right.scatter(some[:, 0], far, **style)
    left.set(
        ylabel="second component, degrees",
        title=f"Bends and splays; {100 * found.explained:.0f} % of the variance",
    )
    left.set_aspect("equal", adjustable="datalim")
    left.legend(fontsize=9)
    right.set(
        ylabel="standard deviations", title="Distance from the mean natural pose", yscale="log"
    )
    for axes in (left, right):
        axes.set(xlabel="first component, degrees")
    figure.savefig(path, dpi=110)
