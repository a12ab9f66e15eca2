"""Several minima of each hand: their Gaussians, their order, repeats, and the fit's own result among them."""

import pytest
import torch

from hand_recon.camera import project
from hand_recon.fitting.descent import Descent, fit, fit_minima
from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import Observation, observed
from hand_recon.fitting.second_order.laplace import covariance_of
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.levenberg_marquardt import Reached
from hand_recon.fitting.second_order.minima import FIXED_SIGMA, POSE, Minima
from hand_recon.fitting.second_order.prior_terms import PriorTerms
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import COUNT, Unknowns
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.natural_pose import NaturalPoseTerm
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.terms import NonPenetrationTerm, RangeOfMotionTerm, ShapeTerm
from hand_recon.schema import HandParameters
from hand_recon.uncertainty import NegativeLogLikelihood
from tests.fitting.second_order.hands import double_hand, random_cameras, random_unknowns
from tests.support.views import known_hands, views


def some_problem(count: int, free: torch.Tensor | None = None) -> tuple[Problem, Unknowns]:
    """The loss of hands at their landmarks, with a Gaussian on the pose."""
    hand, unknowns, cameras = double_hand(), random_unknowns(count), random_cameras(count)
    projection = LandmarkProjection(hand, free)
    at = projection(unknowns, cameras, torch.linalg.inv(cameras))
    points = at.pixels.permute(2, 1, 0)
    seen = Observation(points, torch.ones(count, 21, dtype=torch.bool), cameras)
    prior = Prior({"natural_pose": NaturalPoseTerm(hand), "shape": ShapeTerm(hand)}).double()
    return Problem.of(projection, PriorTerms(prior), NegativeLogLikelihood(), seen), unknowns


def minima_of(problem: Problem, unknowns: Unknowns, hands: int) -> Minima:
    """Every hand's results, none of them repeated."""
    reached = Reached.at(problem, unknowns)
    none = torch.zeros(hands, len(unknowns) // hands, dtype=torch.bool)
    return Minima.of(problem, reached, none)


def test_the_information_is_that_of_the_marginal_covariance() -> None:
    """By another route: the covariance of all unknowns without the rows of shape, with rays for pixels."""
    problem, unknowns = some_problem(2)
    found = minima_of(problem, unknowns, hands=2).information[:, 0]
    by_rays = torch.eye(POSE, dtype=torch.float64).repeat(2, 1, 1)
    by_rays[:, 48:50, 48:50] = torch.linalg.inv(problem.observation.intrinsics[:, :2, :2])
    marginal = covariance_of(problem(unknowns))[:, :POSE, :POSE]
    product = found @ (by_rays @ marginal @ by_rays.mT)
    torch.testing.assert_close(
        product, torch.eye(POSE, dtype=torch.float64).expand(2, POSE, POSE), rtol=0, atol=1e-6
    )


def test_the_place_is_in_rays_and_log_depth() -> None:
    problem, unknowns = some_problem(3)
    found = minima_of(problem, unknowns, hands=3)
    x, y, z = found.parameters.translation[:, 0].unbind(dim=1)
    torch.testing.assert_close(found.place[:, 0], torch.stack([x / z, y / z, z.log()], dim=1))


def test_an_angle_without_freedom_is_known() -> None:
    free = torch.arange(1, COUNT)
    problem, unknowns = some_problem(2, free)
    found = minima_of(problem, unknowns, hands=2).information[:, 0]
    assert torch.equal(found[:, 0, 0], torch.full((2,), FIXED_SIGMA**-2, dtype=torch.float64))
    assert not found[:, 0, 1:].any()
    assert not found[:, 1:, 0].any()
    assert torch.linalg.eigvalsh(found).amin() > 0


def test_of_two_results_of_a_hand_the_lower_and_narrower_costs_more_and_less() -> None:
    """A loss that is larger by d costs d more; the cost has the volume of the Gaussian besides."""
    problem, unknowns = some_problem(1)
    here = Reached.at(problem, unknowns)
    worse = here.model.value + 2.0
    twice = here.joined(Reached(here.unknowns, here.model.__class__(
        worse, here.model.gradient, 4.0 * here.model.curvature, here.model.hinge, here.model.free
    ), here.damping))  # fmt: skip
    both = problem[torch.tensor([0, 0])]
    cost = Minima.of(both, twice, torch.zeros(1, 2, dtype=torch.bool)).cost[0]
    # Four times the curvature in 61 dimensions: log volume smaller by 61 log 2.
    expected = 2.0 + COUNT * torch.tensor(2.0).log()
    torch.testing.assert_close(cost[1] - cost[0], expected.double(), rtol=1e-6, atol=1e-6)


def objective(hand: HandModel, *, natural: bool = True) -> Objective:
    """The likelihood with ranges and non-penetration, and with natural poses or without."""
    terms = {
        "range_of_motion": RangeOfMotionTerm(hand, weight=20_000.0),
        "non_penetration": NonPenetrationTerm(hand, weight=20_000.0),
        "shape": ShapeTerm(hand, weight=10.0),
    }
    if natural:
        terms["natural_pose"] = NaturalPoseTerm(hand)
    return Objective(hand, Prior(terms), NegativeLogLikelihood())


def test_the_first_minimum_is_the_fits_result(hand: HandModel) -> None:
    seen = observed(views(hand, known_hands(hand, 12)))
    alone = fit(seen, objective(hand), descent=Descent()).prediction
    several = fit_minima(seen, objective(hand), descent=Descent())
    first = hand.to_camera(several.parameters).landmarks[:, 0]
    apart = (first - alone.landmarks_3d).norm(dim=-1).amax(dim=1)
    # The fit polishes one start, the minima all of them; one hand in twelve may end elsewhere.
    assert int((apart < 1e-3).sum()) >= 11
    assert several.cost[:, 0].isfinite().all()


def test_minima_differ_and_explain_the_landmarks(hand: HandModel) -> None:
    """Without natural poses, a view leaves several poses that explain it."""
    seen = observed(views(hand, known_hands(hand, 12)))
    found = fit_minima(seen, objective(hand, natural=False), descent=Descent())
    kept = found.cost.isfinite()
    assert int((kept.sum(dim=1) > 1).sum()) >= 3
    points = hand.to_camera(found.parameters).landmarks
    pixels = project(points, seen.intrinsics[:, None].expand(12, points.shape[1], 3, 3))
    error = (pixels - seen.landmarks_2d[:, None]).norm(dim=-1).mean(dim=-1)
    assert float(error[:, 0].max()) < 3.0
    for of_hand, which in zip(points, kept, strict=True):
        different = of_hand[which]
        apart = (different[:, None] - different).norm(dim=-1).amax(dim=-1)
        apart = apart + torch.eye(len(different))
        assert float(apart.min()) > 0.003


def test_a_batch_is_its_hands_one_by_one(hand: HandModel) -> None:
    seen = observed(views(hand, known_hands(hand, 3)))
    whole = fit_minima(seen, objective(hand), descent=Descent())
    assert len(whole) == 3
    for number in range(3):
        one = fit_minima(seen[number : number + 1], objective(hand), descent=Descent())
        torch.testing.assert_close(one.place[0, 0], whole.place[number, 0], rtol=0, atol=1e-3)


def test_a_loss_without_second_derivatives_is_refused(hand: HandModel) -> None:
    class Odd(NaturalPoseTerm):
        """A term of a kind that the solver does not know."""

        def forward(
            self, parameters: HandParameters, vertices: torch.Tensor | None
        ) -> torch.Tensor:
            return super().forward(parameters, vertices) ** 2

    odd = Objective(hand, Prior({"odd": Odd(hand)}), NegativeLogLikelihood())
    seen = observed(views(hand, known_hands(hand, 1)))
    with pytest.raises(ValueError, match="second-order solver, which has no derivatives of"):
        fit_minima(seen, odd, descent=Descent())
