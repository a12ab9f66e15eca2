"""Palms: anchors, decoding and suppression by numbers worked out by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.detection.palms import (
    Palm,
    PalmCandidates,
    PalmNetwork,
    anchors,
    best_of_overlapping,
    decode,
    overlaps,
    suppress,
)


def candidates(*rows: tuple[list[float], float]) -> PalmCandidates:
    """Candidates of boxes and scores, whose seven points are all at the box's upper left corner."""
    boxes = np.array([box for box, _ in rows], dtype=float).reshape(-1, 4)
    points = np.repeat(boxes[:, None, :2], 7, axis=1)
    return PalmCandidates(boxes, points, np.array([score for _, score in rows], dtype=float))


def palm(box: list[float], score: float) -> Palm:
    return Palm(np.array(box, dtype=float), np.zeros((7, 2)), score)


def test_there_are_2016_anchors_at_720_places() -> None:
    centres = anchors()
    assert centres.shape == (2016, 2)
    assert len(np.unique(centres, axis=0)) == 24 * 24 + 12 * 12 == 720


def test_anchors_go_along_rows_with_the_repeats_of_a_cell_together() -> None:
    centres = anchors()
    np.testing.assert_allclose(centres[[0, 1]], [[1 / 48, 1 / 48]] * 2)
    np.testing.assert_allclose(centres[2], [3 / 48, 1 / 48])
    # The second row of the fine grid begins after 24 cells of two.
    np.testing.assert_allclose(centres[48], [1 / 48, 3 / 48])
    np.testing.assert_allclose(centres[1151], [47 / 48, 47 / 48])
    np.testing.assert_allclose(centres[1152:1158], [[1 / 24, 1 / 24]] * 6)
    np.testing.assert_allclose(centres[1158], [3 / 24, 1 / 24])
    np.testing.assert_allclose(centres[2015], [23 / 24, 23 / 24])


def test_decoding_adds_pixels_to_the_anchor() -> None:
    raw = np.zeros((2016, 18), dtype=np.float32)
    # Anchor 0 is at 4 px of 192. The box: centre 8 px right and 4 px down of it, 24 × 48 px.
    raw[0, :4] = [8, 4, 24, 48]
    raw[0, 4:6] = [20, 44]
    raw[0, 16:18] = [-4, 188]
    found = decode(raw, np.zeros(2016, dtype=np.float32), 192)
    np.testing.assert_allclose(found.boxes[0] * 192, [0, -16, 24, 32], atol=1e-9)
    np.testing.assert_allclose(found.points[0, 0] * 192, [24, 48])
    np.testing.assert_allclose(found.points[0, 6] * 192, [0, 192], atol=1e-9)
    assert found.scores[0] == pytest.approx(0.5)


def test_scores_are_clipped_sigmoids() -> None:
    logits = np.zeros(2016, dtype=np.float32)
    logits[:3] = [1e6, -1e6, np.log(3)]
    scores = decode(np.zeros((2016, 18), dtype=np.float32), logits, 192).scores
    np.testing.assert_allclose(scores[:3], np.array([1.0, np.exp(-100.0), 0.75]), atol=1e-7)


def test_boxes_of_negative_size_are_left_out() -> None:
    raw = np.zeros((2016, 18), dtype=np.float32)
    raw[5, 2], raw[6, 3] = -1, -1
    assert len(decode(raw, np.zeros(2016, dtype=np.float32), 192).scores) == 2014


def test_overlap_is_intersection_over_union() -> None:
    box = np.array([0.0, 0, 10, 10])
    others = np.array(
        [[0, 0, 10, 10], [5, 0, 15, 10], [20, 20, 30, 30], [10, 0, 20, 10], [2, 2, 4, 4]], float
    )
    np.testing.assert_allclose(overlaps(box, others), [1, 50 / 150, 0, 0, 4 / 100])


def test_boxes_without_area_overlap_with_nothing() -> None:
    assert overlaps(
        np.array([1.0, 1, 1, 1]), np.array([[1.0, 1, 1, 1], [0, 0, 2, 2]])
    ).tolist() == [
        0,
        0,
    ]


def test_overlapping_candidates_become_their_weighted_mean() -> None:
    # Boxes of 10 × 10, 5 apart: a third. Weights 0.8 and 0.4: two thirds of the way.
    found = suppress(
        candidates(([5, 0, 15, 10], 0.4), ([0, 0, 10, 10], 0.8), ([50, 50, 60, 60], 0.6))
    )
    np.testing.assert_allclose(found.boxes, np.array([[5 / 3, 0, 35 / 3, 10], [50, 50, 60, 60]]))
    np.testing.assert_allclose(found.points[0], [[5 / 3, 0]] * 7)
    assert found.scores.tolist() == [0.8, 0.6]


def test_an_overlap_of_three_tenths_is_not_enough() -> None:
    # 13 wide, shifted by 7: 60 / 200 is exactly 0.3.
    apart = suppress(candidates(([0, 0, 13, 10], 0.8), ([7, 0, 20, 10], 0.7)))
    assert len(apart.scores) == 2
    joined = suppress(candidates(([0, 0, 13, 10], 0.8), ([6.9, 0, 19.9, 10], 0.7)))
    assert len(joined.scores) == 1


def test_a_chain_is_broken_by_the_best() -> None:
    # The middle one is best and overlaps with both ends, which do not overlap with each other.
    found = suppress(
        candidates(([0, 0, 10, 10], 0.5), ([5, 0, 15, 10], 0.9), ([10, 0, 20, 10], 0.5))
    )
    np.testing.assert_allclose(found.boxes, [[5, 0, 15, 10]])


def test_nothing_and_a_box_without_area_are_suppressed_in_finite_time() -> None:
    assert len(suppress(candidates()).scores) == 0
    assert len(suppress(candidates(([3, 3, 3, 3], 0.9), ([3, 3, 3, 3], 0.8))).scores) == 2


@given(st.permutations(range(6)))
def test_the_order_of_candidates_does_not_matter(order: list[int]) -> None:
    rows: list[tuple[list[float], float]] = [
        ([float(x), 0.0, x + 10.0, 10.0], 0.9 - 0.01 * x) for x in (0, 3, 9, 14, 25, 26)
    ]
    shuffled = suppress(candidates(*(rows[index] for index in order)))
    np.testing.assert_allclose(shuffled.boxes, suppress(candidates(*rows)).boxes)
    assert (np.diff(shuffled.scores) <= 0).all()


def test_of_two_looks_the_better_palm_is_kept_as_it_is() -> None:
    kept = best_of_overlapping(
        [palm([0, 0, 10, 10], 0.7), palm([1, 0, 11, 10], 0.9), palm([30, 0, 40, 10], 0.8)]
    )
    assert [one.score for one in kept] == [0.9, 0.8]
    assert kept[0].box.tolist() == [1, 0, 11, 10]
    assert best_of_overlapping([]) == []


class FakePalms:
    """A palm network with fixed output: logits of some anchors, whose boxes are 24 × 24 px about them."""

    input_size = 192

    def __init__(self, logits: dict[int, float]) -> None:
        self.raw = np.zeros((2016, 18), dtype=np.float32)
        self.raw[:, 2:4] = 24
        self.logits = np.full((2016, 1), -50, dtype=np.float32)
        for anchor, logit in logits.items():
            self.logits[anchor] = logit

    def __call__(self, crop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert crop.shape == (192, 192, 3)
        self.crop = crop
        return self.raw, self.logits


def network(logits: dict[int, float]) -> PalmNetwork:
    found = PalmNetwork(lambda: b"")
    vars(found)["network"] = FakePalms(logits)
    return found


@pytest.mark.parametrize(("padding", "margin"), [(1.0, 0), (1.7, 255)])
def test_the_margin_is_black_without_padding_and_the_repeated_edge_with_it(
    padding: float, margin: int
) -> None:
    find = network({})
    assert find(np.full((100, 200, 3), 255, dtype=np.uint8), 0.5, padding) == []
    crop = vars(find)["network"].crop
    assert (crop[:40] == margin).all()
    assert (crop[60:130] == 255).all()


def test_palms_are_in_pixels_of_the_image_not_of_the_letterbox() -> None:
    # Anchor 0 is at 4 px of 192; the square of a 384 × 192 image is 384 px, with 96 px above the image.
    (found,) = network({0: 3.0})(np.zeros((192, 384, 3), dtype=np.uint8), 0.5)
    np.testing.assert_allclose(found.box, [8 - 24, 8 - 24 - 96, 8 + 24, 8 + 24 - 96])
    np.testing.assert_allclose(found.points[2], [8, 8 - 96])


def test_padding_moves_and_scales_palms() -> None:
    # The square has 2 × 100 px, 50 px of it on each side.
    (found,) = network({0: 3.0})(np.zeros((100, 100, 3), dtype=np.uint8), 0.5, 2.0)
    np.testing.assert_allclose(found.points[0], np.full(2, 4 / 192 * 200 - 50))


def test_doubtful_palms_come_last_unless_they_are_of_a_palm_that_was_found() -> None:
    logit = np.log(0.3 / 0.7)
    # Anchors 0 and 1 are at one place; 2000 is far away; −3 is too low to be worth a word.
    found = network({0: 2.0, 1: logit, 2000: logit, 700: -3.0})(
        np.zeros((192, 192, 3), dtype=np.uint8), 0.5
    )
    assert [one.score for one in found] == pytest.approx([1 / (1 + np.exp(-2)), 0.3], abs=1e-6)
