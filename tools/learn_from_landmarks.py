"""Learn from 2D landmarks alone where a detector puts them on the hand, and how living hands are held.

    python -m tools.learn_from_landmarks <folder>/train.json [--only rps,digits] [--hands 1200]

The file has 2D landmarks of many photographs (docs/landmark_files.md). There is no 3D in it. The hand model
is fitted to all of them, and what their residuals have in common is learnt:

1. The offset of each landmark from the rotation centre or fingertip of the hand model, fixed to its bone. One
   image cannot tell it; many hands in many poses can.
2. Mean and covariance of the joint angles, by expectation maximization: the covariance of the fitted angles
   plus the mean of their own covariances (Laplace), shrunk towards what is known without data.

It writes `hand_recon/hand/assets/mediapipe_landmarks.npz` and
`hand_recon/knowledge/tables/natural_poses.npz`. Decision 64 has what was tried and what each step gained.
"""

import argparse
import itertools
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.data.landmarks.crops import to_crops
from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.fitting.descent import Descent, fit
from hand_recon.fitting.objective import Fitted, Objective
from hand_recon.fitting.observation import Observation, observed
from hand_recon.fitting.second_order.laplace import covariance_of
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.prior_terms import PriorTerms
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import Unknowns
from hand_recon.fitting.start import Start
from hand_recon.hand import open_hand as hands
from hand_recon.hand.landmark_offsets import carrying_joints, with_offsets
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES, FINGERS, LANDMARKS, LEVEL_ORDER
from hand_recon.knowledge import natural_pose
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.pose_distance import PoseDistance, PoseDistanceTerm
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.knowledge.terms import RangeOfMotionTerm, ShapeTerm
from hand_recon.uncertainty import NegativeLogLikelihood

OFFSET_ROUNDS: Final = 5
"""Estimates of the offsets. They drift slowly on along poses that look alike; this many are enough to have
what all hands agree on."""

POSE_ROUNDS: Final = 3
"""Steps of expectation maximization."""

OFFSET_SIGMA: Final = 0.008
"""Standard deviation of the offsets before any data, metres."""

ROBUST: Final = 6.0
"""Residual beyond which a landmark counts less, pixels of a 224-pixel crop."""

SHRINKAGE: Final = 0.3
"""Share of the statistics without data in the result: the photographs show few of the poses of life."""

COUPLED: Final = {"DIP and PIP": 15.0, "MCPs": 40.0, "PIPs": 50.0}
"""Standard deviations before any data: of DIP − ⅔ PIP, and of differences between neighbours, degrees."""

KEPT: Final = 0.9
"""Share of the hands, those of least loss, that statistics are computed from."""

LEAST_SIGMA: Final = math.radians(0.6)
"""Standard deviation that is added to every angle, radians."""


@dataclass(frozen=True)
class Statistics:
    """Mean and covariance of the joint angles."""

    mean: Float[Tensor, " angle=45"]
    """Radians."""
    covariance: Float[Tensor, "angle=45 angle=45"]
    """Squared radians."""


def without_data() -> Statistics:
    """Statistics from the ranges and from what the literature says of coupled joints.

    Every angle has the moments of a uniform distribution over its range. DIP ≈ ⅔ PIP (Rijpkema and Girard,
    SIGGRAPH 1991); neighbouring fingers bend together (Häger-Ross and Schieber, J. Neurosci. 20(22), 2000).
    """
    ranges = load_ranges("literature", hands.open_hand().rest_angles)
    lower, upper = ranges.lower.flatten().double(), ranges.upper.flatten().double()
    width = (upper - lower).clamp(min=0.05)
    precision = torch.diag(12 / width**2)
    middle = precision @ ((lower + upper) / 2)
    for first, second, factor, degrees in _couplings():
        row = torch.zeros(45, dtype=torch.float64)
        row[first], row[second] = 1.0, -factor
        precision += torch.outer(row, row) / math.radians(degrees) ** 2
    covariance = torch.linalg.inv(precision)
    return Statistics(covariance @ middle, covariance)


def _couplings() -> list[tuple[int, int, float, float]]:
    """Pairs of angles that bend together: first ≈ factor × second, with a standard deviation in degrees."""
    bend = {name: len(AXES) * place + AXES.index("bend") for place, name in enumerate(ARTICULATED)}
    four = FINGERS[1:]
    found = [(bend[f"{f} DIP"], bend[f"{f} PIP"], 2 / 3, COUPLED["DIP and PIP"]) for f in four]
    for part in ("MCP", "PIP"):
        pairs = itertools.pairwise(four)
        found += [
            (bend[f"{a} {part}"], bend[f"{b} {part}"], 1.0, COUPLED[f"{part}s"]) for a, b in pairs
        ]
    return found


class Learner:
    """Fits of all hands with what is known so far.

    Args:
        observation: The landmarks.
    """

    def __init__(self, observation: Observation) -> None:
        self.observation = observation
        self.asset = hands.load_open_hand()
        self.offsets = torch.zeros(len(LANDMARKS), 3)
        ranges = load_ranges("literature", self.asset.rest_angles)
        self.fixed = ((ranges.upper - ranges.lower) < 1e-3).flatten()
        self.before = without_data()
        self.statistics: Statistics | None = None

    def hand(self) -> HandModel:
        """The open hand with the landmarks as they are known so far."""
        knuckle = self.asset.landmark_regressors["knuckle"]
        regressor = with_offsets(self.asset, knuckle, self.offsets)
        return HandModel(replace(self.asset, landmark_regressors={"learnt": regressor}), "learnt")

    def fitted(self) -> tuple[Fitted, Problem, Unknowns]:
        """Fit every hand, and return the loss with its derivatives about the results."""
        hand = self.hand().landmarks_only()
        ranges = RangeOfMotionTerm(hand, anatomy=FunctionalAnatomy())
        terms = {"range_of_motion": ranges, "shape": ShapeTerm(hand)}
        if self.statistics is not None:
            known = self.statistics
            distance = PoseDistance.of_gaussian(known.mean.float(), known.covariance.float())
            terms["natural_pose"] = PoseDistanceTerm(hand, weight=0.5, distance=distance)
        prior, data_term = Prior(terms), NegativeLogLikelihood()
        found = fit(self.observation, Objective(hand, prior, data_term), descent=Descent())
        start = Start.of(found.prediction.parameters)
        unknowns = Unknowns.of_start(start, self.observation.intrinsics)
        projection = LandmarkProjection(hand)
        problem = Problem.of(projection, PriorTerms(prior), data_term, self.observation)
        return found, problem, unknowns

    def learn_offsets(self) -> float:
        """Improve the offsets once, and return the mean distance of the landmarks before it, pixels."""
        _, problem, unknowns = self.fitted()
        at = problem.projection(unknowns, problem.observation.intrinsics, problem.inverse)
        residual = problem.target - at.pixels.permute(2, 1, 0)
        level = torch.tensor([LEVEL_ORDER.index(joint) for joint in carrying_joints()])
        axes = at.orientations[:, :, level]
        # The wrist's segment has no anatomical axes; its orientation is the hand's.
        slope = torch.einsum("cxlh,xalh->hlca", at.slopes, axes)
        distance = residual.square().sum(dim=-1)
        sigma = problem.log_sigma[..., 0].exp()
        labelled = problem.observation.labelled
        weight = labelled / sigma**2 / (1 + distance / (2 * ROBUST**2))
        matrix = torch.einsum("hlca,hlcb,hl->lab", slope, slope, weight)
        right = torch.einsum("hlca,hlc,hl->la", slope, residual, weight)
        matrix = matrix + torch.eye(3) / OFFSET_SIGMA**2
        right = right - self.offsets / OFFSET_SIGMA**2
        self.offsets = self.offsets + torch.linalg.solve(matrix, right)
        return float((distance.sqrt() * labelled).sum() / labelled.sum())

    def learn_poses(self) -> float:
        """Take one step of expectation maximization, and return the mean loss before it."""
        found, problem, unknowns = self.fitted()
        loss = found.loss["total"]
        kept = loss <= loss.quantile(KEPT)
        angles = unknowns.joint_angles.flatten(1).double()[kept]
        own = covariance_of(problem(unknowns))[kept, :45, :45].double().mean(dim=0)
        mean = angles.mean(dim=0)
        covariance = (angles - mean).mT @ (angles - mean) / len(angles) + own
        known, share = self.before, 1 - SHRINKAGE
        away = torch.outer(mean - known.mean, mean - known.mean)
        mixed = share * covariance + SHRINKAGE * known.covariance + share * SHRINKAGE * away
        mixed[self.fixed] = 0
        mixed[:, self.fixed] = 0
        added = torch.where(self.fixed, 0.01, LEAST_SIGMA**2)
        mean = share * mean + SHRINKAGE * known.mean
        self.statistics = Statistics(mean, mixed + torch.diag(added))
        return float(loss[kept].mean())


def observation_of(path: Path, only: tuple[str, ...], count: int) -> Observation:
    """Landmarks of a random selection of a file's hands, the same on every run.

    Args:
        path: The file.
        only: Folders of the images that are used; all without any.
        count: Number of hands.
    """
    read = read_landmarks(path)
    names = [image.parent.name if image else "" for image in read.images]
    chosen = [place for place, name in enumerate(names) if not only or name in only]
    if not chosen:
        raise SystemExit(f"No image of {path} is in a folder named {' or '.join(only)}.")
    order = np.random.default_rng(0).permutation(len(chosen))[:count]
    return observed(to_crops(read.select(torch.tensor(chosen)[torch.from_numpy(order)])).batch)


def main() -> None:
    """Learn, print what was learnt, and write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("landmarks", type=Path)
    parser.add_argument("--only", default="rps,digits", help="folders of the images that are used")
    parser.add_argument("--hands", type=int, default=1200)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    only = tuple(filter(None, arguments.only.split(",")))
    learner = Learner(observation_of(arguments.landmarks, only, arguments.hands))
    for step in range(OFFSET_ROUNDS):
        print(f"landmarks {step + 1}: {learner.learn_offsets():.3f} px off", flush=True)
    learner.statistics = learner.before
    for step in range(POSE_ROUNDS):
        print(f"poses {step + 1}: loss {learner.learn_poses():.2f}", flush=True)
    write(learner)


def write(learner: Learner) -> None:
    """Write both files, and print them.

    Args:
        learner: What was learnt.
    """
    statistics = learner.statistics
    if statistics is None:
        raise ValueError("No statistics of poses were learnt.")
    landmarks = Path(hands.__file__).parent / hands.DETECTOR_LANDMARKS
    poses = Path(natural_pose.__file__).parent / natural_pose.TABLE
    np.savez(landmarks, offsets=learner.offsets.numpy().astype(np.float32))
    mean, covariance = (v.float().numpy() for v in (statistics.mean, statistics.covariance))
    np.savez(poses, mean=mean, covariance=covariance)
    for name, offset in zip(LANDMARKS, (learner.offsets * 1000).tolist(), strict=True):
        print(f"{name:12} {offset[0]:6.1f} {offset[1]:6.1f} {offset[2]:6.1f} mm")
    sigma = np.degrees(np.sqrt(covariance.diagonal())).reshape(15, 3)
    for name, middle, spread in zip(
        ARTICULATED, np.degrees(mean).reshape(15, 3), sigma, strict=True
    ):
        print(
            f"{name:12} bend {middle[0]:5.0f} ± {spread[0]:2.0f}°, splay {middle[1]:5.0f} ± {spread[1]:2.0f}°"
        )
    print(f"{landmarks}\n{poses}")


if __name__ == "__main__":
    main()
