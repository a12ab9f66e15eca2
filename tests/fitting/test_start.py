"""Closed-form starts: one of the two poses of a plane that look alike from far away is the true one."""

import copy

import pytest
import torch

from hand_recon.camera import default_intrinsics, project
from hand_recon.fitting.start import BENDS, PALM_LANDMARKS, Start, closed_form_starts
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.schema import HandGeometry, HandParameters
from tests.support.views import known_hands, views

COUNT = 200
FAR = 1e7
"""Focal length without visible perspective, pixels."""


class FlatHand(HandModel):
    """The open hand with every landmark projected into the plane of its palm."""

    def forward(self, joint_angles: torch.Tensor, shape: torch.Tensor) -> HandGeometry:
        posed = super().forward(joint_angles, shape)
        points = posed.landmarks
        centre = points[list(PALM_LANDMARKS)].mean(dim=0)
        normal = torch.linalg.svd(points[list(PALM_LANDMARKS)] - centre)[2][2]
        away = (points - centre) @ normal
        return HandGeometry(posed.vertices, posed.joints, points - away[:, None] * normal)


@pytest.fixture(scope="module")
def flat(hand: HandModel) -> HandModel:
    model = copy.deepcopy(hand).double()
    model.__class__ = FlatHand
    return model


def angle(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """Angle between rotations, radians."""
    cosine = ((first.mT @ second).diagonal(dim1=-2, dim2=-1).sum(dim=-1) - 1) / 2
    return cosine.clamp(-1, 1).arccos()


def points_of(model: HandModel, bend: float) -> torch.Tensor:
    pose = torch.zeros_like(model.rest_angles)
    pose[:, 0] = bend
    return model(pose, model.template.new_zeros(10)).landmarks


def seen_from_afar(model: HandModel, bend: float) -> tuple[torch.Tensor, ...]:
    """True rotations, landmarks and cameras of hands that span about 150 pixels."""
    rotation = torch.linalg.qr(torch.randn(COUNT, 3, 3, dtype=torch.float64)).Q
    rotation = rotation * torch.linalg.det(rotation).sign()[:, None, None]
    camera = torch.tensor([[FAR, 0, 112], [0, FAR, 112], [0, 0, 1]], dtype=torch.float64)
    camera = camera.expand(COUNT, 3, 3)
    translation = torch.tensor([0.0, 0.0, FAR * 0.18 / 150], dtype=torch.float64)
    points = points_of(model, bend) @ rotation.mT + translation
    return rotation, project(points, camera), camera


@pytest.mark.parametrize("number", [0, 1])
def test_one_of_both_placements_is_the_true_one(flat: HandModel, number: int) -> None:
    rotation, landmarks, camera = seen_from_afar(flat, BENDS[number])
    labelled = torch.ones(COUNT, 21, dtype=torch.bool)
    starts = closed_form_starts(flat, landmarks, labelled, camera, count=4)
    found = starts.root_rotation[:, 2 * number : 2 * number + 2]
    assert torch.allclose(found @ found.mT, torch.eye(3, dtype=torch.float64), atol=1e-9)
    assert torch.linalg.det(found).sub(1).abs().max() < 1e-9
    off = angle(found, rotation[:, None])
    # The remaining perspective has an effect of its square root, under a hundredth of a radian.
    assert off.amin(dim=1).max() < 0.01
    # For nearly all hands the other pose differs, and neither of the two is always the first.
    assert (off.amax(dim=1) > 0.1).double().mean() > 0.95
    assert 0.2 < (off[:, 0] < off[:, 1]).double().mean() < 0.8


def test_both_placements_show_the_palm_where_it_was_seen(flat: HandModel) -> None:
    _, landmarks, camera = seen_from_afar(flat, BENDS[0])
    labelled = torch.ones(COUNT, 21, dtype=torch.bool)
    starts = closed_form_starts(flat, landmarks, labelled, camera, count=2)
    points = points_of(flat, BENDS[0])
    for which in (0, 1):
        placed = points @ starts.root_rotation[:, which].mT + starts.translation[:, which, None]
        assert (project(placed, camera) - landmarks).norm(dim=-1).max() < 0.05


def shown(start: Start, which: int, hand: HandModel) -> torch.Tensor:
    """Landmarks of one start of each hand, camera frame."""
    count = len(start.translation)
    parameters = HandParameters(
        start.joint_angles[:, which], torch.zeros(count, 10), start.root_rotation[:, which],
        start.translation[:, which],
    )  # fmt: skip
    return hand.to_camera(parameters).landmarks


def test_a_real_palm_is_near_the_better_placement(hand: HandModel) -> None:
    """Right to about 10 degrees for hands that are not flat or far away and have other shapes and poses."""
    ground_truth = known_hands(hand, COUNT)
    batch = views(hand, ground_truth)
    assert batch.intrinsics is not None
    starts = closed_form_starts(hand, batch.landmarks_2d, batch.labelled, batch.intrinsics, 2)
    off = angle(starts.root_rotation, ground_truth.root_rotation[:, None]).rad2deg()
    assert off.amin(dim=1).median() < 12
    assert off.amin(dim=1).quantile(0.9) < 25
    assert off[:, 0].median() > 20  # One alone would not do.
    depth = starts.translation[..., 2] / ground_truth.translation[:, None, 2]
    assert (depth.log().abs().amin(dim=1).median()) < 0.1
    for which in (0, 1):
        pixels = project(shown(starts, which, hand), batch.intrinsics)
        off_palm = (pixels - batch.landmarks_2d)[:, list(PALM_LANDMARKS)].norm(dim=-1)
        assert off_palm.median() < 6


def test_fewer_starts_are_the_first_of_more(hand: HandModel) -> None:
    batch = views(hand, known_hands(hand, 3))
    assert batch.intrinsics is not None
    given = (hand, batch.landmarks_2d, batch.labelled, batch.intrinsics)
    most = closed_form_starts(*given, count=4)
    assert most.root_rotation.shape == (3, 4, 3, 3)
    for count in (1, 2, 3):
        some = closed_form_starts(*given, count=count)
        assert torch.equal(some.root_rotation, most.root_rotation[:, :count])
        assert torch.equal(some.translation, most.translation[:, :count])
        assert torch.equal(some.joint_angles, most.joint_angles[:, :count])
    bends = most.joint_angles[0, :, :, 0].unique(dim=1).flatten()
    assert bends.tolist() == pytest.approx([0.3, 0.3, 0.9, 0.9])
    assert most.joint_angles[..., 1:].count_nonzero() == 0


@pytest.mark.parametrize("count", [0, 5, -1])
def test_there_are_one_to_four_starts(hand: HandModel, count: int) -> None:
    batch = views(hand, known_hands(hand, 1))
    assert batch.intrinsics is not None
    with pytest.raises(ValueError, match=f"Expected 1 to 4 starts, found {count}"):
        closed_form_starts(hand, batch.landmarks_2d, batch.labelled, batch.intrinsics, count)


@pytest.mark.parametrize(
    "left",
    [
        [LANDMARKS.index(name) for name in ("index tip", "middle tip", "ring tip", "little tip")],
        [0, 5, 9, 13, 17],  # The palm alone.
        [5, 6, 7, 8],  # One finger: nearly a line.
        [0, 4, 8],
    ],
)
def test_starts_are_finite_whatever_is_missing(hand: HandModel, left: list[int]) -> None:
    batch = views(hand, known_hands(hand, 50))
    labelled = torch.zeros(50, 21, dtype=torch.bool)
    labelled[:, left] = True
    landmarks = batch.landmarks_2d.masked_fill(~labelled[..., None], torch.nan)
    camera = default_intrinsics(224, landmarks).expand(50, 3, 3)
    starts = closed_form_starts(hand, landmarks, labelled, camera)
    for value in (starts.root_rotation, starts.translation, starts.joint_angles):
        assert value.isfinite().all()
    assert (starts.translation[..., 2] > 0).all()


def test_the_palm_alone_is_enough(hand: HandModel) -> None:
    batch = views(hand, known_hands(hand, 50))
    labelled = torch.zeros(50, 21, dtype=torch.bool)
    labelled[:, list(PALM_LANDMARKS)] = True
    landmarks = batch.landmarks_2d.masked_fill(~labelled[..., None], torch.nan)
    camera = default_intrinsics(224, landmarks).expand(50, 3, 3)
    starts = closed_form_starts(hand, landmarks, labelled, camera)
    for which in range(4):
        seen = project(shown(starts, which, hand), camera)
        off = (seen - batch.landmarks_2d)[:, list(PALM_LANDMARKS)].norm(dim=-1)
        assert off.mean(dim=1).median() < 6


def test_landmarks_that_all_coincide_give_something_finite(hand: HandModel) -> None:
    """A failing detector may put all landmarks at one point."""
    landmarks = torch.full((2, 21, 2), 100.0)
    camera = default_intrinsics(224, landmarks).expand(2, 3, 3)
    starts = closed_form_starts(hand, landmarks, torch.ones(2, 21, dtype=torch.bool), camera)
    assert starts.root_rotation.isfinite().all()
    assert starts.translation.isfinite().all()
