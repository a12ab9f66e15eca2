"""One shape of several hands: the quadratic models that are combined, and hands of a known person."""

import copy
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from hand_recon.fitting.descent import Descent, fit, last_stage
from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import Observation, observed
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.levenberg_marquardt import Limits, Reached, minimize
from hand_recon.fitting.second_order.prior_terms import PriorTerms
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import Unknowns
from hand_recon.fitting.shared_shape import (
    FREEDOM,
    MOST_HANDS,
    ShapeModel,
    combined_shape,
    shared_shape,
    with_shape,
)
from hand_recon.fitting.start import Start
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.terms import RangeOfMotionTerm, ShapeTerm
from hand_recon.schema import HandParameters
from hand_recon.uncertainty import NegativeLogLikelihood, SquaredError, Staged
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views

COUNT = 12
NO_TERMS = Prior({})
"""A prior without terms."""


def quadratic(at: Tensor, information: float) -> ShapeModel:
    """Hands whose loss is least at given shapes, and equally curved in every direction."""
    eye = torch.eye(10, dtype=torch.float64)
    return ShapeModel(at, torch.zeros_like(at), information * eye.expand(len(at), 10, 10))


def direction(size: float, axis: int = 1) -> Tensor:
    shape = torch.zeros(10, dtype=torch.float64)
    shape[axis] = size
    return shape


def likelihood() -> Staged:
    return Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5)


@pytest.fixture(scope="module")
def hand64(hand: HandModel) -> HandModel:
    return copy.deepcopy(hand).double()


@pytest.fixture
def prior(hand: HandModel) -> Prior:
    return Prior(
        {
            "range_of_motion": RangeOfMotionTerm(hand, anatomy=FunctionalAnatomy()),
            "shape": ShapeTerm(hand),
        }
    )


@pytest.fixture
def person(hand: HandModel) -> HandParameters:
    """Hands of one person, who differs from the mean in proportions as well as in size."""
    found = known_hands(hand, COUNT)
    shape = torch.tensor([0.5, 1.5, -1.0, 1.0, 1.5, -1.0, 1.0, 0.5, -0.5, 1.0])
    return replace(found, shape=shape.expand(COUNT, 10).contiguous())


@pytest.fixture
def seen(hand: HandModel, person: HandParameters) -> Observation:
    """Their exact landmarks, said to be off by a pixel."""
    observation = observed(views(hand, person))
    return replace(observation, sigma=torch.ones(COUNT, 21))


def test_one_hand_is_pulled_to_the_mean_by_the_normal_distribution_alone() -> None:
    """Information 3 at the shape 2 against 1 at the mean: 3 · 2 / (3 + 1)."""
    found = combined_shape(quadratic(direction(2.0)[None], 3.0), PriorTerms(NO_TERMS))
    # Its weight: the least loss is away by 3 · 0.5² = 0.75, below what ten coefficients are expected to be.
    torch.testing.assert_close(found, direction(1.5))


def test_agreeing_hands_outweigh_the_normal_distribution() -> None:
    """Ten hands of information 3: 30 · 2 / (30 + 1)."""
    found = combined_shape(quadratic(direction(2.0).expand(10, 10), 3.0), PriorTerms(NO_TERMS))
    torch.testing.assert_close(found, direction(60 / 31))


def test_hands_that_differ_meet_between_in_shares_of_their_information() -> None:
    models = [
        quadratic(direction(1.0)[None], 30.0),
        quadratic(direction(0.9, axis=1)[None], 60.0),
    ]
    both = ShapeModel(
        torch.cat([one.at for one in models]),
        torch.cat([one.gradient for one in models]),
        torch.cat([one.curvature for one in models]),
    )
    found = combined_shape(both, PriorTerms(NO_TERMS))
    torch.testing.assert_close(found, direction((30 * 1.0 + 60 * 0.9) / 91))


def test_a_hand_that_contradicts_the_others_is_all_but_ignored() -> None:
    at = direction(1.0).repeat(9, 1)
    at[0] = direction(-30.0, axis=2)
    found = combined_shape(quadratic(at, 20.0), PriorTerms(NO_TERMS))
    # Its weight in a t distribution, at the squared distance 20 · 30²; the mean would be at −3.3.
    weight = (FREEDOM + 10) / (FREEDOM + 20 * 30**2)
    torch.testing.assert_close(found[2].item(), -30 * 20 * weight / 161, rtol=0.02, atol=0)
    torch.testing.assert_close(found[1], direction(160 / 161)[1], rtol=1e-2, atol=0)


def test_more_hands_than_the_limit_say_no_more() -> None:
    some, many = (
        combined_shape(quadratic(direction(2.0).expand(count, 10), 0.01), PriorTerms(NO_TERMS))
        for count in (MOST_HANDS, 5 * MOST_HANDS)
    )
    torch.testing.assert_close(some, many)


def test_hands_without_information_have_the_mean_shape(prior: Prior) -> None:
    found = combined_shape(quadratic(direction(2.0).expand(5, 10), 0.0), PriorTerms(prior))
    assert found.norm() < 0.05


def test_the_prior_of_the_fit_counts_once(prior: Prior) -> None:
    """The norm pulls with 10 whatever the distance: the least of ½ · 600 (s − 1)² + ½ s² + 10 |s|."""
    found = combined_shape(quadratic(direction(1.0).expand(6, 10), 100.0), PriorTerms(prior))
    torch.testing.assert_close(found, direction(590 / 601), rtol=1e-3, atol=1e-3)


def test_pose_and_place_are_eliminated_as_by_minimizing_over_them(
    hand64: HandModel, person: HandParameters, seen: Observation
) -> None:
    """The gradient by shape at the best pose is the change of the least loss, by finite differences."""
    observation = in_double_precision(seen)
    term = NegativeLogLikelihood()
    prior = Prior({"range_of_motion": RangeOfMotionTerm(hand64)}).double()
    terms = PriorTerms(prior, centred=True)
    free = terms.free()
    start = Start(
        person.joint_angles.double(), person.root_rotation.double(), person.translation.double(),
        torch.zeros(COUNT, 10, dtype=torch.float64),
    )  # fmt: skip
    unknowns = Unknowns.of_start(start, observation.intrinsics)

    def least(shape: Tensor) -> Reached:
        projection = LandmarkProjection(hand64.of_shape(shape), free)
        problem = Problem.of(projection, terms, term, observation)
        return minimize(problem, Reached.at(problem, unknowns), Limits(60, tolerance=1e-15))

    shape, step = direction(0.3), 1e-3
    problem = Problem.of(LandmarkProjection(hand64, free), terms, term, observation)
    here = replace(least(shape).unknowns, shape=shape.expand(COUNT, 10).contiguous())
    model = ShapeModel.of(problem, here)
    for axis in (1, 4):
        above, below = (least(shape + sign * direction(step, axis)).model.value for sign in (1, -1))
        slope = (above - below) / (2 * step)
        # One dispersion scales all hands alike.
        ratio = (model.gradient[:, axis] / slope).median()
        assert 0 < ratio < 1.001
        close = torch.isclose(model.gradient[:, axis], ratio * slope, rtol=0.02, atol=0.05)
        # A hand may end in another minimum after a small change of the shape.
        assert close.sum() >= COUNT - 2


def test_many_hands_find_the_proportions_of_a_person(
    hand: HandModel, person: HandParameters, seen: Observation, prior: Prior
) -> None:
    objective = Objective(hand, prior, likelihood())
    alone = fit(seen, objective, descent=Descent()).prediction.parameters
    last = replace(objective, data_term=last_stage(objective.data_term, seen, Descent()))
    shape = shared_shape(seen, alone, last)
    bones = hand(hand.neutral_angles(), person.shape[0]).landmarks
    assert ratio_error(hand, shape, bones) < 0.5 * ratio_error(hand, torch.zeros(10), bones)
    each = torch.stack([ratio_error(hand, one, bones) for one in alone.shape])
    assert ratio_error(hand, shape, bones) < 0.8 * each.mean()


FEW = [0, 1, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 17]
"""Landmarks without those of the thumb and the last ones of the ring and little finger: eight are missing."""


def singular_priors(hand: HandModel) -> list[Prior]:
    """Priors that leave pose without curvature: no term, and only ranges that do not bound the twist."""
    ranges = RangeOfMotionTerm(hand, anatomy=FunctionalAnatomy(), twist=False)
    return [NO_TERMS, Prior({"range_of_motion": ranges})]


def in_double_precision(observation: Observation) -> Observation:
    """The same landmarks, off by a pixel."""
    return Observation(
        observation.landmarks_2d.double(), observation.labelled, observation.intrinsics.double(),
        torch.ones(COUNT, 21, dtype=torch.float64),
    )  # fmt: skip


def with_few_landmarks(observation: Observation, hands: list[int]) -> Observation:
    labelled = observation.labelled.clone()
    labelled[hands] = False
    labelled[torch.tensor(hands)[:, None], FEW] = True
    return replace(observation, labelled=labelled)


@pytest.mark.parametrize("which", [0, 1])
def test_landmarks_that_are_missing_take_information_away(
    hand64: HandModel, person: HandParameters, seen: Observation, which: int
) -> None:
    """At the ground truth, where residuals are zero, a hand knows less of the shape with fewer landmarks."""
    start = Start(
        person.joint_angles.double(), person.root_rotation.double(), person.translation.double(),
        person.shape.double(),
    )  # fmt: skip
    unknowns = Unknowns.of_start(start, seen.intrinsics.double())
    terms = PriorTerms(singular_priors(hand64)[which].double(), centred=True)
    projection = LandmarkProjection(hand64, terms.free())

    def model(observation: Observation) -> ShapeModel:
        problem = Problem.of(
            projection, terms, NegativeLogLikelihood(), in_double_precision(observation)
        )
        return ShapeModel.of(problem, unknowns)

    full, few = model(seen), model(with_few_landmarks(seen, [0, 3]))
    # The data term divides by the share of landmarks that there are.
    share = torch.ones(COUNT, 1, 1, dtype=torch.float64)
    share[[0, 3]] = len(FEW) / 21
    lost = torch.linalg.eigvalsh(full.curvature - share * few.curvature)
    largest = full.curvature.diagonal(dim1=1, dim2=2).amax()
    assert lost.min() > -1e-6 * largest
    assert (lost.amax(dim=1) > 1e-3 * largest).nonzero().flatten().tolist() == [0, 3]


@pytest.mark.parametrize("which", [0, 1])
def test_hands_with_missing_landmarks_leave_the_shape_to_the_others(
    hand: HandModel, person: HandParameters, seen: Observation, which: int
) -> None:
    """With all landmarks of twelve hands, or 13 of two of them, the person's proportions are found."""
    objective = Objective(hand, singular_priors(hand)[which], SquaredError())
    shapes = [
        shared_shape(observation, person, objective)
        for observation in (seen, with_few_landmarks(seen, [2, 7]))
    ]
    bones = hand(hand.neutral_angles(), person.shape[0]).landmarks
    mean = ratio_error(hand, torch.zeros(10), bones)
    for shape in shapes:
        assert shape.isfinite().all()
        assert ratio_error(hand, shape, bones) < 0.8 * mean
    every = with_few_landmarks(seen, list(range(COUNT)))
    assert shared_shape(every, person, objective).isfinite().all()


def ratio_error(hand: HandModel, shape: Tensor, landmarks: Tensor) -> Tensor:
    """Mean relative error of the distances from the wrist, up to the size, which one view does not give."""
    found, expected = (
        (points[1:] - points[0]).norm(dim=-1).log()
        for points in (hand(hand.neutral_angles(), shape).landmarks, landmarks)
    )
    away = found - expected
    return (away - away.mean()).abs().mean()


def test_a_fit_of_a_hand_of_one_shape_is_a_fit_of_the_model_with_this_shape(
    hand: HandModel, person: HandParameters, seen: Observation, prior: Prior
) -> None:
    shape = person.shape[0]
    found = fit(
        seen, Objective(hand.of_shape(shape), prior, likelihood()), descent=Descent(starts=2)
    )
    again = with_shape(found, shape, prior)
    assert_close(again.prediction.parameters.shape, shape.expand(COUNT, 10))
    posed = hand.to_camera(again.prediction.parameters)
    assert_close(posed.landmarks, found.prediction.landmarks_3d)
    # The data term of this objective is in the stage in which the fit ended.
    last = last_stage(likelihood(), seen, Descent())
    expected = Objective(hand, prior, last)(again.prediction.parameters, seen).loss
    assert again.loss.keys() == expected.keys()
    for name, value in expected.items():
        torch.testing.assert_close(again.loss[name], value, rtol=1e-3, atol=1e-2)
    torch.testing.assert_close(again.loss["shape"], shape.norm().expand(COUNT))
