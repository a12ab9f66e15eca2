from dataclasses import replace

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import landmark_permutation
from hand_recon.inspection.labels import curls_to_the_palm, examine_labels
from hand_recon.schema import HandBatch
from tests.support.views import known_hands, views


@pytest.fixture(scope="module")
def batch(hand: HandModel) -> HandBatch:
    torch.manual_seed(1)
    return views(hand, known_hands(hand, 60))


def mirrored(batch: HandBatch) -> HandBatch:
    assert batch.landmarks_3d is not None
    return replace(batch, landmarks_3d=batch.landmarks_3d * torch.tensor([-1.0, 1.0, 1.0]))


def test_labels_that_are_right_raise_no_alarm(batch: HandBatch) -> None:
    report = examine_labels(batch)
    assert report.troubles == ()
    assert report.numbers["samples"] == 60
    assert 85 < report.numbers["palm_mm_p50"] < 125
    assert report.numbers["reprojection_px224_p95"] < 1e-3
    assert report.numbers["bend_as_right_hands_percent"] == 100
    assert set(report.labelled.values()) == {1.0}


def test_noise_of_annotators_and_missing_landmarks_raise_none(batch: HandBatch) -> None:
    noisy = batch.landmarks_2d + 1.5 * torch.randn_like(batch.landmarks_2d)
    labelled = torch.rand(60, 21) < 0.9
    noisy = noisy.masked_fill(~labelled[..., None], torch.nan)
    report = examine_labels(replace(batch, landmarks_2d=noisy, labelled=labelled))
    assert report.troubles == ()
    assert report.labelled["thumb tip"] == pytest.approx(labelled[:, 4].double().mean())


@pytest.mark.parametrize("order", ["ho3d", "rhd", "interhand", "dart"])
def test_a_wrong_order_is_named(batch: HandBatch, order: str) -> None:
    written = list(landmark_permutation("freihand", order))
    assert batch.landmarks_3d is not None
    wrong = replace(
        batch,
        landmarks_2d=batch.landmarks_2d[:, written],
        landmarks_3d=batch.landmarks_3d[:, written],
    )
    troubles = examine_labels(wrong).troubles
    for space in ("2D", "3D"):
        assert any(
            f"{space} landmarks look to be in the order of '{order}'" in one for one in troubles
        )


def test_millimetres_mirrors_and_open_gl_are_diagnosed(batch: HandBatch) -> None:
    assert batch.landmarks_3d is not None
    millimetres = replace(batch, landmarks_3d=batch.landmarks_3d * 1000)
    assert any("another unit than metres" in one for one in examine_labels(millimetres).troubles)
    assert any("mirrored" in one for one in examine_labels(mirrored(batch)).troubles)
    flipped = batch.landmarks_3d * torch.tensor([1.0, -1.0, -1.0])
    assert any(
        "OpenGL" in one for one in examine_labels(replace(batch, landmarks_3d=flipped)).troubles
    )


def test_a_camera_of_another_image_size_is_diagnosed(batch: HandBatch) -> None:
    assert batch.intrinsics is not None
    wrong = replace(batch, intrinsics=batch.intrinsics * torch.tensor([2.0, 2.0, 1.0])[:, None])
    troubles = examine_labels(wrong).troubles
    assert len(troubles) == 1
    assert "px (of a 224-pixel crop) from the 2D labels" in troubles[0]


def test_without_3d_only_the_2d_labels_are_judged(batch: HandBatch) -> None:
    report = examine_labels(replace(batch, landmarks_3d=None, vertices=None))
    assert report.troubles == ()
    assert not any("palm" in name or "reprojection" in name for name in report.numbers)


def test_a_right_hand_curls_to_where_its_palm_faces() -> None:
    # The wrist at the origin, fingers to +y, as a camera sees the back of a right hand with y up: little
    # finger at +x. The palm faces +z or −z; fingers bend towards one of them only.
    landmarks = torch.zeros(1, 21, 3)
    for finger, across in enumerate((-0.03, -0.01, 0.01, 0.03)):
        first = 5 + 4 * finger
        landmarks[0, first] = torch.tensor([across, 0.09, 0.0])
        landmarks[0, first + 3] = torch.tensor([across, 0.10, -0.05])
    # (index − wrist) × (little − wrist) = (−0.03, 0.09, 0) × (0.03, 0.09, 0) points to −z.
    assert [bool(one) for one in curls_to_the_palm(landmarks)] == [True, True]
    assert [bool(one) for one in curls_to_the_palm(landmarks * torch.tensor([-1.0, 1, 1]))] == [
        True,
        False,
    ]
    landmarks[0, 8::4, 2] = 0.0
    curled, _ = curls_to_the_palm(landmarks)
    assert not curled.any()
