"""Hands of a file are grouped into scenes, and what cannot be exported is refused."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.fitting.hand_records import joined_records
from hand_recon.fitting.hands_file import to_records
from hand_recon.formats.by_name import write
from hand_recon.formats.exported_hands import exported_hands
from hand_recon.hand.model import HandModel
from tests.support.exported import clip, clip_hands, photographs, records_of
from tests.support.trajectories import still_hand


def test_a_clip_is_one_scene_with_the_motions_that_were_saved(hand: HandModel) -> None:
    (scene,) = clip(hand).scenes
    assert (scene.name, scene.image, scene.is_still) == ("clip", None, False)
    assert [one.name for one in scene.hands] == ["hand_1_left", "hand_2_right"]
    for found, given in zip(scene.trajectories, clip_hands(), strict=True):
        for name in ("frames", "times", "joint_angles", "root_rotation", "translation", "shape"):
            np.testing.assert_allclose(getattr(found, name), getattr(given, name), atol=1e-12)
    assert list(scene.frames) == [0, 1, 2, 4, 5, 6, 7, 8, 9]
    assert scene.frames[9] == pytest.approx(0.3)


def test_rows_of_a_clip_may_be_in_any_order(hand: HandModel) -> None:
    parts = [records_of(one, hand) for one in clip_hands()]
    whole = joined_records(parts)
    order = np.random.default_rng(0).permutation(len(whole))
    columns: dict[str, Any] = {
        name: tuple(values[row] for row in order) if isinstance(values, tuple) else values[order]
        for name, values in vars(whole).items()
        if name != "loss"
    }
    (scene,) = exported_hands(replace(whole, **columns), hand).scenes
    by_number = sorted(scene.hands, key=lambda one: one.trajectory.hand)
    for found, given in zip(by_number, clip(hand).scenes[0].hands, strict=True):
        assert found.trajectory.frames.tolist() == given.trajectory.frames.tolist()
        np.testing.assert_array_equal(found.landmarks, given.landmarks)
        np.testing.assert_array_equal(found.covariance, given.covariance)


def test_photographs_are_scenes_with_names_that_file_systems_take(hand: HandModel) -> None:
    scenes = photographs(hand).scenes
    assert [scene.name for scene in scenes] == ["two-hands", "b-far"]
    assert [scene.image for scene in scenes] == ["two hands.jpg", "b/far.png"]
    assert [[one.name for one in scene.hands] for scene in scenes] == [
        ["hand_1_right", "hand_2_left"], ["hand_1_right"],
    ]  # fmt: skip
    assert all(scene.is_still for scene in scenes)


def test_hands_without_images_are_scenes_of_their_own(hand: HandModel) -> None:
    one = records_of(still_hand(), hand, of_clip=False)
    named = replace(one, names=("GIVEN",))
    scenes = exported_hands(joined_records([one, named, one]), hand).scenes
    assert [scene.name for scene in scenes] == ["given", "GIVEN-2", "given-3"]


def test_hands_that_are_not_fitted_are_left_out_aloud(
    hand: HandModel, caplog: pytest.LogCaptureFixture
) -> None:
    one = records_of(still_hand(), hand, of_clip=False)
    failed = replace(one, verdicts=("not fitted",))
    with caplog.at_level(logging.WARNING):
        assert len(exported_hands(joined_records([failed, one]), hand).scenes) == 1
    assert "Left out 1 of 2 hands, which are not fitted." in caplog.text
    with pytest.raises(ValueError, match="Found no fitted hand among 1"):
        exported_hands(failed, hand)


def test_an_empty_file_has_no_reasons_to_look_at(hand: HandModel) -> None:
    with pytest.raises(ValueError, match=r"Found no fitted hand among 0 .*The file is empty\.$"):
        exported_hands(to_records([], "hands.json"), hand)


def test_long_names_of_other_scripts_are_cut_to_what_file_systems_take(
    hand: HandModel, tmp_path: Path
) -> None:
    one = records_of(still_hand(), hand, image=f"{'手' * 80}.jpg", of_clip=False)
    hands = exported_hands(joined_records([one, one]), hand)
    assert hands.scenes[0].name == "手" * 40
    for path in write("mot", hands, tmp_path):
        assert path.is_file()


def test_hands_of_another_model_are_refused_with_the_cure(hand: HandModel) -> None:
    one = records_of(still_hand(), hand, of_clip=False)
    with pytest.raises(ValueError, match=r"hand model mano; the model .* is open.*Add hand=mano"):
        exported_hands(replace(one, hand_models=("mano",)), hand)
    with pytest.raises(ValueError, match=r"hand=closed; one file has hands of one model"):
        exported_hands(replace(one, hand_models=("closed",)), hand)


def test_a_clip_hand_with_two_poses_in_a_frame_or_two_shapes_is_refused(hand: HandModel) -> None:
    one = records_of(clip_hands()[0], hand)
    with pytest.raises(ValueError, match="14 poses in 7 frames; expected one side"):
        exported_hands(joined_records([one, one]), hand)
    shape = one.shape.copy()
    shape[3, 0] += 0.5
    with pytest.raises(ValueError, match=r"shapes that differ by 0\.5"):
        exported_hands(replace(one, shape=shape), hand)
