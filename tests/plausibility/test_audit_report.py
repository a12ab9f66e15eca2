"""Drawings, the map and the page of an audit."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.plausibility.audit_report import terminal_tables
from hand_recon.plausibility.drawing import MARGIN, ORANGE, RED, SIDE, draw_hand
from hand_recon.plausibility.given_hands import of_points
from hand_recon.plausibility.natural_map import natural_map
from hand_recon.plausibility.page import Page, PageTable, PictureOfHand, shown, write_page
from tests.support.audited_hands import (
    audit_of,
    bent,
    given_angles,
    models_of,
    natural_angles,
    points_of,
    unnatural_angles,
)


def pixels_of(image: np.ndarray, colour: tuple[int, int, int]) -> int:
    return int((image == np.array(colour)).all(axis=-1).sum())


def test_joints_beyond_the_limit_are_red_and_lesser_violations_orange(hand: HandModel) -> None:
    models = models_of(hand)
    angles = (bent(index_PIP_bend=-60), bent(index_PIP_bend=110), bent(index_PIP_bend=90))
    found = [draw_hand(audit_of(given_angles(one), hand), models, 0) for one in angles]
    assert found[0].shape == (SIDE, 2 * (SIDE + MARGIN), 3)
    counts = [(pixels_of(image, RED) > 50, pixels_of(image, ORANGE) > 50) for image in found]
    assert counts == [(True, False), (False, True), (False, False)]


def test_a_left_hand_is_drawn_as_the_mirror_image_of_a_right_one(hand: HandModel) -> None:
    models, given = models_of(hand), given_angles(bent(index_PIP_bend=60))
    right, left = (
        draw_hand(audit_of(replace(given, left=(side,)), hand), models, 0) for side in (False, True)
    )
    for start in (MARGIN, SIDE + 2 * MARGIN):
        views = [image[: SIDE - 40, start : start + SIDE].astype(int) for image in (right, left)]
        assert np.abs(views[1][:, ::-1] - views[0]).mean() < 2.0
        assert np.abs(views[1] - views[0]).mean() > 5.0


def test_hands_with_missing_points_and_without_a_mesh_are_drawn(hand: HandModel) -> None:
    models = models_of(hand)
    points = points_of(hand, bent(ring_PIP_bend=-60))
    points[0, LANDMARKS.index("thumb tip")] = np.nan
    image = draw_hand(audit_of(of_points(points, "x", left=[False]), hand), models, 0)
    assert pixels_of(image, RED) > 50


def test_unnatural_poses_are_farther_from_natural_ones_than_other_natural_poses(
    hand: HandModel,
) -> None:
    sideways = natural_map(audit_of(given_angles(unnatural_angles("sideways", 40)), hand))
    natural = natural_map(audit_of(given_angles(natural_angles(40, seed=9)), hand))
    assert sideways.implausible.all()
    assert not natural.implausible.all()
    assert sideways.audited_distance.min() > np.quantile(natural.natural_distance, 0.99)
    assert natural.audited_distance.mean() < 1.3 * natural.natural_distance.mean()
    assert 0.0 < sideways.explained < 1.0
    assert np.abs(sideways.natural.mean(axis=0)).max() < 1e-9


def test_the_distance_of_natural_poses_is_one_standard_deviation(hand: HandModel) -> None:
    """A little less, because every angle has some noise in the distance that the poses do not have."""
    found = natural_map(audit_of(given_angles(natural_angles(2)), hand))
    mean_square = float(np.square(found.natural_distance).mean())
    assert 0.3 < mean_square < 1.0


def test_a_page_cannot_be_changed_by_names(tmp_path: Path) -> None:
    picture = PictureOfHand("worst/a b.png", "<script>", "implausible", ["1 < 2"])
    tables = (PageTable("T", ("a", "b"), [["x & y", 1.25]]), PageTable("empty", ("a",), []))
    write_page(tmp_path / "index.html", Page("<b>", tables, ["note <i>"], None, [picture]))
    page = (tmp_path / "index.html").read_text()
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert 'src="worst/a%20b.png"' in page
    assert "x &amp; y" in page
    assert ">empty<" not in page


def test_cells_are_text_numbers_or_dashes() -> None:
    assert [shown(value) for value in ("a", 3, 2.04, None, float("nan"))] == [
        "a",
        "3",
        "2.0",
        "–",
        "–",
    ]


def test_the_terminals_table_names_every_violated_joint(hand: HandModel) -> None:
    audit = audit_of(given_angles(bent(index_PIP_bend=-60, thumb_IP_bend=90)), hand)
    _, joints, _ = terminal_tables(audit)
    assert [row[0] for row in joints.rows] == ["index PIP bend", "thumb IP bend"]
    assert joints.rows[0][1] == "-10 to 100"
