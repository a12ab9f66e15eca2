"""Covariances of 3D landmarks: derivatives, Gaussians about a minimum, mixtures, and where there are none."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from hand_recon.data.landmarks.crops import to_crops, uncrop_prediction
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.descent import Descent, fit
from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import Observation, observed
from hand_recon.fitting.second_order.landmark_covariance import (
    Minimum,
    mixed_covariance,
)
from hand_recon.fitting.second_order.laplace import (
    SMALLEST,
    covariance_of,
    factor_of,
    log_volume_of,
)
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.levenberg_marquardt import Reached
from hand_recon.fitting.second_order.prior_terms import PriorTerms
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import COUNT, Unknowns
from hand_recon.fitting.start import Start
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.natural_pose import NaturalPoseTerm
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.terms import RangeOfMotionTerm, ShapeTerm
from hand_recon.uncertainty import DataTerm, NegativeLogLikelihood, SquaredError, Staged
from hand_recon.uncertainty.covariance_correction import correction_named
from tests.fitting.second_order.hands import double_hand, random_cameras, random_unknowns
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views


def some_problem(count: int = 2) -> tuple[Problem, Unknowns]:
    """The loss of hands that are a little off their landmarks, with a Gaussian on the pose."""
    hand, unknowns, cameras = double_hand(), random_unknowns(count), random_cameras(count)
    projection = LandmarkProjection(hand)
    at = projection(unknowns, cameras, torch.linalg.inv(cameras))
    points = at.pixels.permute(2, 1, 0)
    seen = Observation(points, torch.ones(count, 21, dtype=torch.bool), cameras)
    prior = Prior({"natural_pose": NaturalPoseTerm(hand), "shape": ShapeTerm(hand)}).double()
    return Problem.of(projection, PriorTerms(prior), NegativeLogLikelihood(), seen), unknowns


@pytest.mark.parametrize("every_second", [False, True])
def test_derivatives_of_the_points_are_autograds(every_second: bool) -> None:
    hand, unknowns, cameras = double_hand("mano"), random_unknowns(3), random_cameras(3)
    inverse = torch.linalg.inv(cameras)
    free = torch.cat([torch.arange(0, 45, 2 if every_second else 1), torch.arange(45, COUNT)])
    projection = LandmarkProjection(hand, free)
    at = projection(unknowns, cameras, inverse)

    def points(step: Tensor) -> Tensor:
        parameters = unknowns.moved(step).parameters(inverse)
        from_origin = hand.to_camera(parameters).landmarks - parameters.translation[:, None]
        return from_origin.permute(0, 2, 1).flatten(1).sum(dim=0)

    zero = torch.zeros(3, COUNT, dtype=torch.float64)
    expected = torch.autograd.functional.jacobian(points, zero).permute(1, 0, 2)[..., free]
    torch.testing.assert_close(projection.point_jacobian(at), expected, rtol=1e-6, atol=1e-7)
    assert_close(at.points.permute(2, 1, 0), hand.to_camera(unknowns.parameters(inverse)).landmarks
                 - unknowns.translation(inverse)[:, None])  # fmt: skip


def test_the_covariance_inverts_the_curvature() -> None:
    problem, unknowns = some_problem()
    model = problem(unknowns)
    eye = torch.eye(COUNT, dtype=torch.float64).expand(2, COUNT, COUNT)
    largest = model.curvature.diagonal(dim1=1, dim2=2).amax(dim=1)[:, None, None]
    product = covariance_of(model) @ (model.curvature + SMALLEST * largest * eye)
    torch.testing.assert_close(product, eye, rtol=0, atol=1e-6)
    expected = -0.5 * torch.linalg.slogdet(model.curvature).logabsdet
    torch.testing.assert_close(log_volume_of(factor_of(model)), expected, rtol=0, atol=1e-2)


def test_samples_of_the_gaussian_spread_as_the_covariance_says() -> None:
    problem, unknowns = some_problem(1)
    minimum = Minimum.of(problem, Reached.at(problem, unknowns))
    covariance = covariance_of(problem(unknowns))[0]
    # A hundredth of the steps, so that points move linearly.
    steps = torch.distributions.MultivariateNormal(
        torch.zeros(COUNT, dtype=torch.float64), covariance / 1e4
    ).sample((20_000,))
    many = unknowns[torch.zeros(len(steps), dtype=torch.long)].moved(steps)
    cameras = problem.observation.intrinsics.expand(len(steps), 3, 3)
    points = problem.projection(many, cameras, torch.linalg.inv(cameras)).points.permute(2, 1, 0)
    for landmark in (0, 4, 8, 20):
        found = 1e4 * torch.cov(points[:, landmark].mT)
        scale = float(minimum.covariance[0, landmark].diagonal().amax())
        torch.testing.assert_close(
            found, minimum.covariance[0, landmark], rtol=0, atol=0.06 * scale
        )


def one(x: float, log_mass: float, covariance: float = 0.0) -> Minimum:
    """A hand whose landmarks are all at x metres, each with the same variance along every axis."""
    points = torch.zeros(1, 21, 3)
    points[..., 0] = x
    matrix = (covariance * torch.eye(3)).expand(1, 21, 3, 3)
    return Minimum(points, matrix, torch.tensor([log_mass]))


def test_two_minima_of_equal_mass() -> None:
    """Half of the mass is 2 cm away along x: ½ · 0.02² there, and nothing along the other axes."""
    found = mixed_covariance(one(0.0, -3.0), one(0.02, -3.0), 1)
    expected = torch.diag(torch.tensor([0.5 * 0.02**2, 0.0, 0.0])).expand(1, 21, 3, 3)
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-9)


def test_a_minimum_counts_by_its_mass() -> None:
    """With a third of the other's mass: ¼ · (0.02² + 1e-4) + ¾ · 4e-4 along x."""
    log_third = float(torch.tensor(1 / 3).log())
    found = mixed_covariance(one(0.0, 0.0, 4e-4), one(0.02, log_third, 1e-4), 1)
    along_x = 0.25 * (0.02**2 + 1e-4) + 0.75 * 4e-4
    torch.testing.assert_close(found[0, :, 0, 0], torch.full((21,), along_x))
    torch.testing.assert_close(found[0, :, 1, 1], torch.full((21,), 0.25 * 1e-4 + 0.75 * 4e-4))


def test_the_same_minimum_counts_once() -> None:
    others = [one(0.001, 0.0), one(0.02, 0.0)]
    both = Minimum(*(torch.cat([getattr(o, name) for o in others])
                     for name in ("points", "covariance", "log_mass")))  # fmt: skip
    found = mixed_covariance(one(0.0, 0.0), both, 2)
    torch.testing.assert_close(found, mixed_covariance(one(0.0, 0.0), one(0.02, 0.0), 1))


def test_a_result_without_a_loss_is_left_out() -> None:
    found = mixed_covariance(one(0.0, 0.0, 1e-4), one(0.02, float("nan")), 1)
    torch.testing.assert_close(found[0, 3], 1e-4 * torch.eye(3), rtol=1e-4, atol=1e-9)


def priors(hand: HandModel) -> dict[str, Prior]:
    """Priors with and without a loss on every angle."""
    return {
        "ranges": Prior({"range_of_motion": RangeOfMotionTerm(hand), "shape": ShapeTerm(hand)}),
        "natural": Prior({"natural_pose": NaturalPoseTerm(hand), "shape": ShapeTerm(hand)}),
        "none": Prior({"shape": ShapeTerm(hand)}),
    }


@pytest.mark.parametrize(
    "likelihood",
    [
        NegativeLogLikelihood(),
        Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5),
    ],
)
@pytest.mark.parametrize("prior", ["ranges", "natural"])
def test_a_fit_has_covariances(hand: HandModel, likelihood: DataTerm, prior: str) -> None:
    seen = views(hand, known_hands(hand, 6))
    found = fit(observed(seen), Objective(hand, priors(hand)[prior], likelihood), descent=Descent())
    covariance = found.prediction.covariance_3d
    assert covariance is not None
    torch.testing.assert_close(covariance, covariance.mT)
    # What the correction adds across the line of sight, at the landmarks where it adds least.
    correction = correction_named("living")
    assert correction is not None
    least = torch.linalg.eigvalsh(covariance.double()).amin()
    assert float(least) >= 0.99 * float(correction.across.square().amin())
    # One view shows depth worse than the other directions; fingertips are farther from the origin than MCPs.
    variance = covariance.diagonal(dim1=2, dim2=3).mean(dim=(0, 1))
    assert variance[2] > 2 * variance[:2].amax()
    size = covariance.diagonal(dim1=2, dim2=3).sum(dim=2).mean(dim=0)
    assert size[[8, 12, 16, 20]].amin() > size[[5, 9, 13, 17]].amax()


def test_hidden_landmarks_are_less_certain(hand: HandModel) -> None:
    seen = views(hand, known_hands(hand, 6))
    hidden = replace(seen, labelled=seen.labelled.clone())
    hidden.labelled[:, 6:9] = False
    objective = Objective(hand, priors(hand)["natural"], NegativeLogLikelihood())
    sizes = []
    for given in (seen, hidden):
        covariance = fit(observed(given), objective, descent=Descent()).prediction.covariance_3d
        assert covariance is not None
        sizes.append(covariance.diagonal(dim1=2, dim2=3).sum(dim=2))
    assert (sizes[1][:, 8] > 2 * sizes[0][:, 8]).float().mean() > 0.8


@pytest.mark.parametrize(
    ("solver", "prior", "term"),
    [
        ("adam", "natural", NegativeLogLikelihood()),
        ("second_order", "none", NegativeLogLikelihood()),
        ("second_order", "natural", SquaredError()),
        ("second_order", "natural", NegativeLogLikelihood(beta=0.5)),
        ("second_order", "natural",
         Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5, keep_balance=True)),
    ],
)  # fmt: skip
def test_without_an_estimate_there_are_none(
    hand: HandModel, solver: str, prior: str, term: DataTerm
) -> None:
    seen = views(hand, known_hands(hand, 2))
    descent = Descent(solver=solver, steps=4)
    found = fit(observed(seen), Objective(hand, priors(hand)[prior], term), descent=descent)
    assert found.prediction.covariance_3d is None


def test_left_hands_mirror_right_ones(hand: HandModel) -> None:
    seen = views(hand, known_hands(hand, 1))
    points = seen.landmarks_2d.double()
    assert seen.intrinsics is not None
    camera = seen.intrinsics.double()
    mirrored = points * torch.tensor([-1.0, 1.0]) + torch.tensor([2 * float(camera[0, 0, 2]), 0.0])
    both = ImageLandmarks(
        landmarks_2d=torch.cat([points, mirrored]),
        labelled=seen.labelled.repeat(2, 1),
        left=torch.tensor([False, True]),
        names=("right", "left"),
        intrinsics=camera.repeat(2, 1, 1),
    )
    crops = to_crops(both)
    objective = Objective(hand, priors(hand)["natural"], NegativeLogLikelihood())
    found = fit(observed(crops.batch), objective, descent=Descent()).prediction
    covariance = uncrop_prediction(crops, found).covariance_3d
    assert covariance is not None
    sign = torch.tensor([-1.0, 1.0, 1.0])
    expected = covariance[0] * sign[:, None] * sign
    torch.testing.assert_close(covariance[1], expected, rtol=1e-3, atol=1e-8)
    assert float(covariance[0, :, 0, 2].abs().amax()) > 1e-6


def test_one_start_is_one_minimum(hand: HandModel) -> None:
    """With a single start, the covariance is that of the result alone: the start is no minimum."""
    seen = observed(views(hand, known_hands(hand, 4)))
    objective = Objective(hand, priors(hand)["natural"], NegativeLogLikelihood())
    descent = Descent(starts=1, finger_table=False, error_bars="laplace")
    result = fit(seen, objective, descent=descent).prediction
    problem = Problem.of(
        LandmarkProjection(hand), PriorTerms(objective.prior), objective.data_term, seen
    )
    unknowns = Unknowns.of_start(Start.of(result.parameters), seen.intrinsics)
    alone = Minimum.of(problem, Reached.at(problem, unknowns))
    assert result.covariance_3d is not None
    torch.testing.assert_close(result.covariance_3d, alone.covariance, rtol=2e-2, atol=1e-7)


@pytest.mark.parametrize("name", ["living", "synthetic"])
def test_laplaces_covariance_can_be_recovered_from_a_fits(hand: HandModel, name: str) -> None:
    seen = observed(views(hand, known_hands(hand, 3)))
    objective = Objective(hand, priors(hand)["natural"], NegativeLogLikelihood())
    plain, corrected = (
        fit(seen, objective, descent=Descent(error_bars=bars)).prediction
        for bars in ("laplace", name)
    )
    correction = correction_named(name)
    assert correction is not None
    assert corrected.covariance_3d is not None
    assert plain.covariance_3d is not None
    recovered = correction.laplace_of(
        corrected.covariance_3d.double(), corrected.parameters.translation.double()
    )
    # Of numbers in single precision with what was added taken away again.
    torch.testing.assert_close(recovered.float(), plain.covariance_3d, rtol=1e-3, atol=1e-9)
