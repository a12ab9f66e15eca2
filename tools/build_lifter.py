"""Train the lifter of the package and write its file: `make shipped-lifter`.

Needs no dataset, no download and no GPU. One thread; the seed fixes all draws, and the same machine with the
same package versions gives the same file.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import torch

from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from hand_recon.knowledge.terms import RangeOfMotionTerm, ShapeTerm
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.lifter_file import SHIPPED, save_lifter
from lifter_training.poses import sample_hands
from lifter_training.training import Report, Trainer, Training

RANGES = "literature"
"""Table of ranges of motion, of the prior and of the poses that are drawn from it."""

LANDMARK_SET = "mediapipe"
"""Landmark set of the lifter: that of `fit` and `predict` by default."""

COMMAND = "make shipped-lifter"
"""The command, for the file's header."""


def build(training: Training, report: Report = print) -> Regressor:
    """Train a lifter.

    Args:
        training: Settings.
        report: Called with a line of progress now and then.

    Returns:
        The lifter with the open hand.
    """
    hand = open_hand(LANDMARK_SET)
    ranges = load_ranges(RANGES, hand.rest_angles)
    hands = sample_hands(training.poses, hand.landmarks_only(), ranges, training.seed)
    report(f"{len(hands)} hands without penetration, of {training.poses.hands}")
    trained = Trainer(hands, hand, knowledge(hand, ranges), training).run(report)
    lifter = training.network.build(hand)
    lifter.load_state_dict(trained.state_dict())
    return lifter.eval()


def knowledge(hand: HandModel, ranges: RangeOfMotion) -> Prior:
    """Ranges of motion with functional anatomy, and shape: the knowledge that needs no surface.

    Args:
        hand: Hand model.
        ranges: Ranges of motion.
    """
    anatomy = RangeOfMotionTerm(hand, ranges=ranges, anatomy=FunctionalAnatomy())
    return Prior({"range_of_motion": anatomy, "shape": ShapeTerm(hand)})


def main() -> None:
    """Train and write the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=SHIPPED, help="the file (%(default)s)")
    parser.add_argument("--steps", type=int, default=Training.steps, help="%(default)s")
    parser.add_argument("--seed", type=int, default=Training.seed, help="%(default)s")
    given = parser.parse_args()
    torch.set_num_threads(1)
    training = replace(Training(), steps=given.steps, seed=given.seed)
    lifter = build(training, lambda line: print(line, flush=True))
    origin = {"command": COMMAND, "steps": str(given.steps), "seed": str(given.seed)}
    digest = save_lifter(given.output, lifter, training.network, origin)
    size = given.output.stat().st_size
    print(f"{given.output}: {size / 1e6:.2f} MB, weights {digest}")


if __name__ == "__main__":
    main()
