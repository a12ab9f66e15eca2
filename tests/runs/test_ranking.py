"""Images in the order in which labels help most: values, likeness, reasons, and what it is worth."""

import math
from pathlib import Path

import numpy as np
import pytest

from error_bars.annotating import Views
from error_bars.records import uncertain_hands
from hand_recon.runs.ranking import ALIKE, DOUBT, UNFITTED, UNFOUND, ranked_images
from hand_recon.runs.ranking_file import check_ranking
from measure_ranking import curves, main


def poses(count: int, seed: int = 0) -> np.ndarray:
    """Hands that are unlike each other, 10 cm long, with the root at the origin."""
    points = np.random.default_rng(seed).normal(size=(count, 21, 3))
    points[:, 9] = 0.0
    return 0.1 * points / np.linalg.norm(points, axis=-1).max(axis=1)[:, None, None]


def bars(*sigmas: float) -> np.ndarray:
    """Covariance of landmarks with one σ in millimetres for each hand."""
    variances = np.square(1e-3 * np.array(sigmas))
    return variances[:, None, None, None] * np.tile(np.eye(3), (21, 1, 1))


def test_images_are_sorted_by_their_error_bars() -> None:
    hands = uncertain_hands(["a", "b", "c"], poses(3), bars(5, 9, 7))
    found = ranked_images(hands, ["a", "b", "c"])
    assert [one.image for one in found] == ["b", "c", "a"]
    assert [one.value for one in found] == pytest.approx([9, 7, 5])
    # They are farther apart than hands whose labels say something about each other.
    assert [one.gain for one in found] == pytest.approx([9, 7, 5], rel=0.02)


def test_the_value_is_the_root_mean_square_over_landmarks_and_axes() -> None:
    """20 landmarks of (1, 2, 2) mm and one of (12, 24, 24): √((20 · 3 + 432) / 21), the largest √432."""
    covariance = np.tile(1e-6 * np.diag([1.0, 4.0, 4.0]), (1, 21, 1, 1))
    covariance[0, 8] *= 144
    (found,) = ranked_images(uncertain_hands(["a"], poses(1), covariance), ["a"])
    assert found.value == pytest.approx(math.sqrt((20 * 3 + 432) / 21))
    assert found.reason == (
        "The right hand is uncertain by 5 mm, most at the index tip (21 mm)."
    )  # fmt: skip


def test_of_images_that_are_alike_the_others_come_last() -> None:
    """Ten frames of one hand, and two hands of smaller error bars: these come second and third."""
    points = np.concatenate([np.repeat(poses(1), 10, axis=0), poses(2, seed=1)])
    names = [f"frame {number}" for number in range(10)] + ["b", "c"]
    hands = uncertain_hands(names, points, bars(*np.linspace(20, 19, 10), 4, 5))
    found = ranked_images(hands, names)
    assert [one.image for one in found[:3]] == ["frame 0", "c", "b"]
    assert all(one.gain == pytest.approx(0.0) for one in found[3:])
    assert all(one.reason.endswith("Like frame 0, which is listed before.") for one in found[3:])
    assert not any("Like" in one.reason for one in found[:3])


def test_likeness_falls_with_the_distance_as_said() -> None:
    """One hand beside another whose landmarks are all `ALIKE` hand lengths away: 1 − exp(−½) is left."""
    first = poses(1)[0]
    second = first.copy()
    length = np.linalg.norm(first, axis=-1).max()
    # Steps in any direction for all but the root and the farthest landmark, which give place and size.
    free = [
        row for row in range(21) if row not in (9, int(np.linalg.norm(first, axis=-1).argmax()))
    ]
    second[free, 0] += ALIKE * length * math.sqrt(21 / len(free)) * -np.sign(second[free, 0])
    hands = uncertain_hands(["a", "b"], np.stack([first, second]), bars(10, 8))
    found = ranked_images(hands, ["a", "b"])
    assert np.linalg.norm(second, axis=-1).max() == pytest.approx(length)
    assert found[1].gain == pytest.approx(8 * (1 - math.exp(-0.5)))


def test_a_left_hand_is_like_the_right_one_that_it_mirrors() -> None:
    right = poses(1)[0]
    points = np.stack([right, right * [-1.0, 1.0, 1.0]])
    names = ["a", "b"]
    mirrored = uncertain_hands(names, points, bars(9, 8), sides=["right", "left"])
    assert ranked_images(mirrored, names)[1].gain == pytest.approx(0.0)
    alike = uncertain_hands(names, points, bars(9, 8))
    assert ranked_images(alike, names)[1].gain > 7


def test_doubtful_and_missing_hands_have_values_and_reasons() -> None:
    names = ["plausible", "doubtful", "not fitted", "empty"]
    hands = uncertain_hands(
        names[:3], poses(3), bars(8, 6, 1), ["plausible", "doubtful", "not fitted"]
    )
    found = {one.image: one for one in ranked_images(hands, names)}
    assert found["plausible"].value == pytest.approx(8)
    assert found["doubtful"].value == pytest.approx(6 + DOUBT)
    assert found["not fitted"].value == UNFITTED
    assert found["empty"].value == UNFOUND
    assert found["doubtful"].reason.endswith("It is doubtful: A reason.")
    assert found["not fitted"].reason == "The right hand could not be fitted: A reason."
    assert found["empty"].reason == "No hand was found: label it if there is one."


def test_images_without_hands_count_less_one_by_one() -> None:
    found = ranked_images(uncertain_hands([], poses(0), bars()), ["a", "b", "c"])
    assert [one.gain for one in found] == pytest.approx([UNFOUND, UNFOUND / 2, UNFOUND / 3])
    assert [one.image for one in found] == ["a", "b", "c"]


def test_an_image_has_the_value_of_its_worst_hand() -> None:
    hands = uncertain_hands(
        ["a", "a", "b"], poses(3), bars(3, 9, 6), sides=["right", "left", "right"]
    )
    found = ranked_images(hands, ["a", "b"])
    assert [one.image for one in found] == ["a", "b"]
    assert found[0].value == pytest.approx(9)
    assert found[0].reason.startswith("The left hand is uncertain by 9 mm")


def test_without_covariances_sigma_in_the_image_counts_at_the_hands_distance() -> None:
    """σ of 4 px half a metre away with a focal length of 500 px: 4 mm."""
    hands = uncertain_hands(["a"], poses(1), np.full((1, 21, 3, 3), np.nan))
    hands.sigma_2d[:] = 4.0
    (found,) = ranked_images(hands, ["a"])
    assert found.value == pytest.approx(4.0)
    hands.sigma_2d[:] = np.nan
    (found,) = ranked_images(hands, ["a"])
    assert (found.value, found.reason) == (UNFOUND, "The right hand has no error bars.")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rank": "best", "folder": True}, "Found rank=best; expected uncertainty, or null"),
        ({"rank": "uncertainty", "folder": False}, r"with json=- and no output; to_annotate\.csv is"),
        ({"rank": "uncertainty", "folder": True, "photographs": False}, "and a video; expected photo"),
    ],
)  # fmt: skip
def test_what_cannot_be_ranked_is_refused(arguments: dict[str, bool], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        check_ranking(**arguments)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("views")


def test_labels_of_the_images_listed_first_lower_the_error_faster(cache: Path) -> None:
    """Frames of clips, six repetitions with the same first labels; at random it takes more labels.

    Four standard errors of the paired change are less than the change itself.
    """
    single, held_out = Views.of("train", 200, cache), Views.of("val", 100, cache)
    errors = np.stack(
        [
            curves(single.as_clips(60, 250, seed), held_out, seed, step=10, rounds=2)
            for seed in range(6)
        ]
    )
    ranked, random = errors.transpose(1, 0, 2)
    np.testing.assert_allclose(ranked[:, 0], random[:, 0])
    change = (ranked - random)[:, 1:].mean(axis=1)
    assert change.mean() + 4 * change.std(ddof=1) / math.sqrt(len(change)) < 0


def test_the_measurement_prints_both_kinds_of_images(
    cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["--seeds", "2", "--hands", "200", "--cache", str(cache)])
    printed = capsys.readouterr().out
    assert printed.count("| frames of clips |") == printed.count("| single images |") == 5
