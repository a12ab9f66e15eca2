"""Hands on their photograph: where they project to, near before far, at every size of image."""

import dataclasses
import logging

import numpy as np
import pytest
import trimesh

from hand_recon.hand.model import HandModel
from hand_recon.rendering.mesh import from_above
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.visualization.hand_overlay import (
    HAND_COLOURS,
    LARGEST_DRAWING,
    DrawnHand,
    OverlayStyle,
    draw_hands,
)

BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
FACES = np.asarray(BALL.faces)
BARE = OverlayStyle(opacity=1.0, skeleton=False, panels=False)


def hand(x: float = 0.0, z: float = 0.6, side: str = "right", focal: float = 200.0) -> DrawnHand:
    """A ball in the middle of an image of 120 × 80, with its landmarks on a circle about it."""
    camera = np.array([[focal, 0, 60], [0, focal, 40], [0, 0, 1.0]])
    around = np.linspace(0, 2 * np.pi, 21)
    centre = np.array([60 + focal * x / z, 40.0])
    circle = centre + focal * 0.05 / z * np.stack([np.cos(around), np.sin(around)], axis=1)
    vertices = np.asarray(BALL.vertices) + np.array([x, 0.0, z])
    return DrawnHand(vertices=vertices, landmarks_2d=circle, intrinsics=camera, side=side)


def grey(height: int = 80, width: int = 120) -> np.ndarray:
    return np.full((height, width, 3), 128, dtype=np.uint8)


def share_of(image: np.ndarray, side: str) -> np.ndarray:
    """Mask of the pixels with the colour of a side's meshes, at any brightness."""
    colour = np.array(HAND_COLOURS[side]) / np.linalg.norm(HAND_COLOURS[side])
    values = image.astype(float)
    norm = np.linalg.norm(values, axis=-1)
    return (values @ colour) / norm.clip(min=1) > 0.995


def test_without_hands_the_photograph_is_returned_as_it_is() -> None:
    image = grey()
    drawn = draw_hands(image, [], FACES)
    assert (drawn == image).all()
    assert drawn is not image


def test_the_photograph_itself_is_not_changed() -> None:
    image = grey()
    drawn = draw_hands(image, [hand()], FACES)
    assert (image == 128).all()
    assert (drawn[:80, :120] != 128).any()


def test_a_hand_is_drawn_where_it_projects_to_in_the_colour_of_its_side() -> None:
    for side, other in (("right", "left"), ("left", "right")):
        drawn = draw_hands(grey(), [hand(x=0.06, side=side)], FACES, BARE)
        rows, columns = np.nonzero(share_of(drawn, side))
        assert abs(columns.mean() + 0.5 - 80) < 0.5
        assert abs(rows.mean() + 0.5 - 40) < 0.5
        assert not share_of(drawn, other).any()


@pytest.mark.parametrize("reverse", [False, True])
def test_the_nearer_of_two_hands_hides_the_other(reverse: bool) -> None:
    hands = [hand(z=0.5, side="left"), hand(x=0.04, z=0.8, side="right")]
    drawn = draw_hands(grey(), hands[::-1] if reverse else hands, FACES, BARE)
    assert share_of(drawn, "left")[40, 60]
    # Column 79 is 60 + 200 · 0.04 / 0.8 + 9: inside the far ball, just outside the near one.
    assert share_of(drawn, "left")[40, 76]
    assert share_of(drawn, "right")[40, 81] == (81 < 60 + 200 * 0.09 / 0.8)


def test_two_interlocked_hands_are_each_seen_in_part() -> None:
    hands = [hand(x=-0.03, side="left"), hand(x=0.03, side="right")]
    drawn = draw_hands(grey(), hands, FACES, BARE)
    assert share_of(drawn, "left")[:, :59].any()
    assert not share_of(drawn, "left")[:, 61:].any()
    assert share_of(drawn, "right")[:, 61:].any()
    assert not share_of(drawn, "right")[:, :59].any()


def test_hands_behind_the_camera_or_without_a_mesh_are_left_out_with_a_warning(
    caplog: pytest.LogCaptureFixture,
) -> None:
    behind = dataclasses.replace(hand(z=-0.6), label="1")
    lost = dataclasses.replace(hand(), vertices=np.full((len(BALL.vertices), 3), np.nan), label="2")
    with caplog.at_level(logging.WARNING):
        drawn = draw_hands(grey(), [behind, lost], FACES)
    assert (drawn == grey()).all()
    assert caplog.messages == [
        "Hand 1, right is not drawn: it is behind the camera.",
        "Hand 2, right is not drawn: its mesh is not known.",
    ]


@pytest.mark.parametrize("x", [-0.2, 0.2, 3.0, -50.0])
def test_a_hand_partly_or_wholly_outside_leaves_the_rest_alone(x: float) -> None:
    drawn = draw_hands(grey(), [hand(x=x)], FACES, BARE)
    assert drawn.shape == (80, 120, 3)
    assert (drawn[:, 50:70] == 128).all()
    assert share_of(drawn, "right").any() == (abs(x) < 1)


@pytest.mark.parametrize("size", [(1, 1), (1, 300), (300, 1), (17, 31)])
def test_every_size_of_image_is_drawn(size: tuple[int, int]) -> None:
    full = dataclasses.replace(
        hand(), given_2d=hand().landmarks_2d + 1, sigma_2d=np.full((21, 2), 3.0), label="1"
    )
    assert draw_hands(grey(*size), [full], FACES, OverlayStyle(panels=False)).shape == (*size, 3)
    with_panels = draw_hands(grey(*size), [full, full, full], FACES)
    assert with_panels.shape[0] >= size[0]
    assert with_panels.shape[1] > size[1]
    assert not (with_panels[: size[0], : size[1]] == 128).all()


def test_a_large_photograph_is_scaled_down_with_its_hand(caplog: pytest.LogCaptureFixture) -> None:
    style = dataclasses.replace(BARE, largest=60)
    with caplog.at_level(logging.INFO):
        drawn = draw_hands(grey(), [hand(x=0.06)], FACES, style)
    assert drawn.shape == (40, 60, 3)
    rows, columns = np.nonzero(share_of(drawn, "right"))
    # The title covers the top of the ball.
    assert abs(columns.mean() + 0.5 - 40) < 0.5
    assert abs(rows.mean() + 0.5 - 20) < 1.5
    assert caplog.messages == ["The drawing of 120 × 80 pixels is scaled down to 60 × 40."]


def test_a_small_photograph_is_enlarged_only_on_request_and_by_a_whole_number() -> None:
    assert draw_hands(grey(), [hand()], FACES, BARE).shape == (80, 120, 3)
    drawn = draw_hands(grey(), [hand(x=0.06)], FACES, dataclasses.replace(BARE, smallest=300))
    assert drawn.shape == (240, 360, 3)
    rows, columns = np.nonzero(share_of(drawn, "right"))
    assert abs(columns.mean() + 0.5 - 3 * 80) < 0.5
    assert abs(rows.mean() + 0.5 - 3 * 40) < 0.5


def test_a_photograph_of_12000_pixels_is_drawn_within_the_limit() -> None:
    # One row of pixels: the size in one direction without the memory of both.
    camera = np.array([[20000.0, 0, 6000], [0, 20000, 0], [0, 0, 1]])
    wide = dataclasses.replace(hand(), intrinsics=camera)
    drawn = draw_hands(grey(1, 12_000), [wide], FACES, BARE)
    assert drawn.shape == (1, LARGEST_DRAWING, 3)
    columns = np.nonzero(share_of(drawn, "right")[0])[0]
    assert abs(columns.mean() + 0.5 - LARGEST_DRAWING / 2) < 1


def test_covariances_go_before_sigma_and_both_scale_with_the_image() -> None:
    point = np.full((21, 2), np.nan)
    point[8] = 60, 40
    plain = dataclasses.replace(hand(), landmarks_2d=point)
    style = dataclasses.replace(BARE, opacity=0.0)

    def extent(drawn: np.ndarray) -> np.ndarray:
        # The title is grey, the ellipse is not.
        rows, columns = np.nonzero(np.ptp(drawn.astype(int), axis=-1) > 4)
        return np.array([np.ptp(columns), np.ptp(rows)])

    sigma = dataclasses.replace(plain, sigma_2d=np.full((21, 2), [10.0, 2.0]))
    flat = np.broadcast_to(np.diag([100.0, 4.0]), (21, 2, 2))
    both = dataclasses.replace(plain, sigma_2d=np.full((21, 2), 1.0), covariance=flat)
    expected = np.array([40, 8])
    assert np.abs(extent(draw_hands(grey(), [sigma], FACES, style)) - expected).max() <= 3
    assert np.abs(extent(draw_hands(grey(), [both], FACES, style)) - expected).max() <= 3
    larger = dataclasses.replace(style, smallest=300)
    assert np.abs(extent(draw_hands(grey(), [sigma], FACES, larger)) - 3 * expected).max() <= 4
    assert np.abs(extent(draw_hands(grey(), [both], FACES, larger)) - 3 * expected).max() <= 4


def test_the_title_says_number_side_and_verdict() -> None:
    assert dataclasses.replace(hand(), label="3", doubtful=True).title == "3, right, doubtful"
    assert hand(side="left").title == "left"


def test_a_doubtful_hand_has_a_yellow_title() -> None:
    yellow = (255, 200, 40)
    for doubtful in (False, True):
        drawn = draw_hands(grey(), [dataclasses.replace(hand(), doubtful=doubtful)], FACES, BARE)
        assert (drawn == yellow).all(axis=-1).any() == doubtful


def test_a_side_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="side 'both'; expected 'left' or 'right'"):
        hand(side="both")


def test_panels_show_every_hand_from_the_side_and_from_above() -> None:
    # A rod along the viewing direction is a point from the front, wide from the side, high from above.
    rod = trimesh.creation.box(extents=(0.01, 0.01, 0.2))
    one = dataclasses.replace(hand(), vertices=np.asarray(rod.vertices) + np.array([0, 0, 0.6]))
    drawn = draw_hands(grey(512, 600), [one], np.asarray(rod.faces))
    assert drawn.shape == (512, 600 + 256, 3)
    extents = []
    for panel in (drawn[:256, 600:], drawn[256:, 600:]):
        rows, columns = np.nonzero(share_of(panel, "right"))
        extents.append((np.ptp(columns), np.ptp(rows)))
    assert extents[0][0] > 5 * extents[0][1]
    assert extents[1][1] > 5 * extents[1][0]


def test_panels_show_two_sigma_of_depth_as_width_and_as_height() -> None:
    """σ of 25 mm in depth in a hand of 20 cm: 2 · 2 · 25 mm are half of the hand's 0.9 of the panel."""
    rod = trimesh.creation.box(extents=(0.2, 0.2, 0.2))
    middle = np.array([0.0, 0.0, 0.6])
    one = dataclasses.replace(
        hand(),
        vertices=np.asarray(rod.vertices) + middle,
        landmarks_3d=np.tile(middle, (21, 1)),
        covariance_3d=np.tile(np.diag([1e-12, 1e-12, 0.025**2]), (21, 1, 1)),
    )
    bare = dataclasses.replace(one, covariance_3d=None)
    with_bars, without = (
        draw_hands(grey(512, 600), [each], np.asarray(rod.faces)).astype(int)
        for each in (one, bare)
    )
    changed = np.abs(with_bars - without).max(axis=-1) > 60
    extents = []
    for top in (30, 286):
        # Below the captions, which differ as well.
        rows, columns = np.nonzero(changed[top : top + 226, 600:])
        extents.append((np.ptp(columns), np.ptp(rows)))
    # The room below a caption is about 236 pixels: 0.45 · 236 = 106, and the ends of a line.
    assert extents[0][0] == pytest.approx(106, abs=8)
    assert extents[0][1] < 20
    assert extents[1][1] == pytest.approx(106, abs=8)
    assert extents[1][0] < 20


def test_from_above_what_is_nearer_is_lower_and_what_is_right_is_right() -> None:
    # A wedge: its near end is wide, its far end at the right.
    corners = np.array([[-0.05, 0, 0.5], [0.05, 0, 0.5], [0.05, 0, 0.7], [0.05, 0.001, 0.6]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]])
    image = from_above(corners, faces, 120)
    rows, columns = np.nonzero((image < 250).any(axis=-1))
    lower, upper = columns[rows > 80], columns[rows < 40]
    assert np.ptp(lower) > 2 * np.ptp(upper)
    assert upper.mean() > lower.mean()


@pytest.mark.parametrize("count", [1, 2, 3, 12, 14])
def test_panels_of_many_hands_stand_in_columns_of_pairs(count: int) -> None:
    hands = [dataclasses.replace(hand(), label=str(number)) for number in range(count)]
    drawn = draw_hands(grey(256, 64), hands, FACES)
    # Two panels of 128 pixels below each other; no more than twelve hands.
    assert drawn.shape == (256, 64 + 128 * min(count, 12), 3)


def test_the_predicted_hand_covers_its_projected_landmarks(
    hand_model: HandModel, scene: tuple[HandBatch, HandPrediction]
) -> None:
    _, prediction = scene
    one = DrawnHand(
        vertices=prediction.vertices[0].double().numpy(),
        landmarks_2d=prediction.landmarks_2d[0].double().numpy(),
        intrinsics=prediction.intrinsics[0].double().numpy(),
        side="right",
    )
    drawn = draw_hands(grey(64, 64), [one], hand_model.faces.numpy(), BARE)
    inside = one.landmarks_2d[[0, 5, 9, 13, 17]].astype(int)
    assert all(share_of(drawn, "right")[v, u] for u, v in inside)


@pytest.fixture
def hand_model(request: pytest.FixtureRequest) -> HandModel:
    """The open hand, under a name that the function `hand` leaves free."""
    model: HandModel = request.getfixturevalue("hand")
    return model
