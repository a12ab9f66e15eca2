"""Starts, batches and repetitions of fits of known hands."""

import copy
import itertools
from collections.abc import Mapping
from dataclasses import replace

import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.camera import project
from hand_recon.data.augment import move
from hand_recon.fitting.descent import Descent, fit
from hand_recon.fitting.lift import lifted_start
from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import Observation, observed
from hand_recon.fitting.start import Start
from hand_recon.hand.model import HandModel
from hand_recon.hand.upright import upright_motion
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.terms import ShapeTerm, Term
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.schema import HandBatch, HandParameters
from hand_recon.uncertainty import NegativeLogLikelihood, SquaredError, Staged
from tests.support.known_fits import COUNT, distance, without_penetration
from tests.support.views import known_hands, views


@pytest.fixture(scope="module")
def double(hand: HandModel) -> HandModel:
    """The hand in double precision: descent amplifies no rounding differences of sums in another order."""
    return copy.deepcopy(hand).double()


@pytest.fixture
def prior(hand: HandModel) -> Prior:
    return without_penetration(hand)


@pytest.fixture
def seen(hand: HandModel) -> HandBatch:
    return views(hand, known_hands(hand, COUNT))


def in_double(batch: HandBatch) -> Observation:
    known = observed(batch)
    sigma = None if known.sigma is None else known.sigma.double()
    return Observation(
        known.landmarks_2d.double(), known.labelled, known.intrinsics.double(), sigma
    )


def test_more_starts_never_end_higher(double: HandModel, prior: Prior, seen: HandBatch) -> None:
    losses = [
        fit(in_double(seen), Objective(double, prior, SquaredError()),
            descent=Descent(solver="adam", starts=starts, steps=60, non_penetration_from=1.0)).loss["total"]
        for starts in (1, 2, 4)
    ]  # fmt: skip
    for fewer, more in itertools.pairwise(losses):
        assert (more <= fewer * (1 + 1e-6)).all()
    assert (losses[2] < 0.5 * losses[0]).any()  # Some hands end much lower.


class Asked(Prior):
    """Records how many hands and vertices every call had."""

    def __init__(self, terms: Mapping[str, Term]) -> None:
        super().__init__(terms)
        self.asked: list[tuple[int, int | None]] = []

    def forward(
        self, parameters: HandParameters, vertices: Float[Tensor, "*batch vertex 3"] | None = None
    ) -> dict[str, Float[Tensor, "*batch"]]:
        count = None if vertices is None else vertices.shape[1]
        self.asked.append((len(parameters.shape), count))
        return super().forward(parameters, vertices)


def test_surfaces_join_late_and_for_the_best_start_alone(hand: HandModel, seen: HandBatch) -> None:
    prior = Asked({"shape": ShapeTerm(hand)})
    descent = Descent(solver="adam", starts=2, steps=10, non_penetration_from=0.6)
    fit(observed(seen), Objective(hand, prior, SquaredError()), descent=descent)
    # Without the term: six steps and the choice of the start; with it: four steps and the result.
    assert prior.asked == [(2 * COUNT, None)] * 7 + [(COUNT, len(hand.template))] * 5


def test_the_batch_does_not_matter(double: HandModel, prior: Prior, seen: HandBatch) -> None:
    whole, parts = (
        fit(in_double(seen), Objective(double, prior, SquaredError()),
            descent=Descent(solver="adam", starts=2, steps=60, hands_at_once=at_once))
        for at_once in (256, 6)
    )  # fmt: skip
    torch.testing.assert_close(
        parts.prediction.landmarks_3d, whole.prediction.landmarks_3d, atol=1e-6, rtol=0
    )
    torch.testing.assert_close(parts.loss["total"], whole.loss["total"], atol=1e-5, rtol=1e-5)


def test_the_same_fit_twice_is_the_same_to_the_bit(
    hand: HandModel, prior: Prior, seen: HandBatch
) -> None:
    descent = Descent(solver="adam", steps=30)
    first, second = (
        fit(observed(seen), Objective(hand, prior, SquaredError()), descent=descent)
        for _ in range(2)
    )
    assert torch.equal(first.prediction.landmarks_3d, second.prediction.landmarks_3d)


def test_further_starts_are_tried_beside_the_closed_form(hand: HandModel, prior: Prior) -> None:
    ground_truth = known_hands(hand, COUNT)
    ground_truth = replace(ground_truth, shape=torch.zeros(COUNT, 10))
    seen = views(hand, ground_truth)

    def told(_: Observation) -> Start:
        return Start(
            ground_truth.joint_angles[:, None],
            ground_truth.root_rotation[:, None],
            ground_truth.translation[:, None],
            ground_truth.shape[:, None],
        )

    alone = Descent(solver="adam", starts=0, steps=1, learning_rate=1e-6)
    found = fit(observed(seen), Objective(hand, prior, SquaredError()), descent=alone, further=told)
    assert float(distance(found, seen).max()) < 0.05
    beside = Descent(solver="adam", starts=2, steps=1, learning_rate=1e-6)
    found = fit(
        observed(seen), Objective(hand, prior, SquaredError()), descent=beside, further=told
    )
    assert float(distance(found, seen).max()) < 0.05


def test_a_lifters_answer_is_where_it_saw_the_hand(hand: HandModel, seen: HandBatch) -> None:
    """In any camera and roll, the start projects to the lifter's prediction in its own camera."""
    network = Regressor(LandmarkEncoder(width=16, depth=1), hand, width=16, dropout=0.0).eval()
    assert seen.intrinsics is not None
    cameras = seen.intrinsics.clone()
    cameras[:, :2, 2] += torch.tensor([40.0, -25.0])
    cameras[:, 0, 0] = cameras[:, 1, 1] = 800.0
    given = observed(replace(seen, intrinsics=cameras))
    start = lifted_start(network, given)
    assert start.root_rotation.shape == (COUNT, 1, 3, 3)
    motion = upright_motion(seen.landmarks_2d, seen.labelled, 224)
    upright = move(replace(seen, intrinsics=None), motion)
    prediction = network(upright)
    back = torch.linalg.inv(motion.pixels)
    expected = prediction.landmarks_2d @ back[:, :2, :2].mT + back[:, None, :2, 2]
    posed = hand(start.joint_angles[:, 0], prediction.parameters.shape).landmarks
    placed = posed @ start.root_rotation[:, 0].mT + start.translation[:, 0, None]
    off = (project(placed, cameras) - expected).norm(dim=-1)
    # Another focal length changes the perspective by pixels, not by tenths of them.
    assert float(off.mean().detach()) < 6.0


def test_without_a_start_there_is_no_fit(hand: HandModel, prior: Prior, seen: HandBatch) -> None:
    with pytest.raises(ValueError, match=r"descent\.starts=0 and no lifter"):
        fit(
            observed(seen),
            Objective(hand, prior, SquaredError()),
            descent=Descent(solver="adam", starts=0),
        )


def test_no_hand_is_fitted_to_none(hand: HandModel, seen: HandBatch) -> None:
    prior = Prior.default(hand)
    term = Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5)
    none = observed(seen.select(slice(0)))
    found = fit(none, Objective(hand, prior, term), descent=Descent(solver="adam", steps=4))
    assert found.prediction.vertices.shape == (0, len(hand.template), 3)
    assert all(value.shape == (0,) for value in found.loss.values())
