"""Files of hands to play: frames in order, hands of a frame together, meshes as the hand model has them."""

from dataclasses import replace

import numpy as np
import pytest

from hand_recon.fitting.hand_records import HandRecords, joined_records
from hand_recon.hand.model import HandModel
from hand_recon.page.posed_files import played_frames, posed, selected
from tests.support.exported import GAP, clip_hands, records_of
from tests.support.trajectories import in_camera


@pytest.fixture
def records(hand: HandModel) -> HandRecords:
    return joined_records([records_of(one, hand) for one in clip_hands()])


def test_frames_of_a_clip_are_in_the_order_of_time_with_all_their_hands(
    records: HandRecords,
) -> None:
    frames = played_frames(records)
    numbers = [int(frame.label.removeprefix("Frame ")) for frame in frames]
    # The left hand is missing in a gap that begins before the right one comes.
    assert numbers == [0, 1, 2, *(n for n in GAP if n >= 4), 6, 7, 8, 9]
    assert [frame.time for frame in frames] == pytest.approx([n / 30 for n in numbers])
    sides = {
        number: [records.sides[row] for row in frame.rows]
        for number, frame in zip(numbers, frames, strict=True)
    }
    assert sides[2] == ["left"]
    assert sides[5] == ["right"]
    assert sides[7] == ["left", "right"]


def test_photographs_follow_each_other_in_the_order_of_the_file(records: HandRecords) -> None:
    some = replace(
        selected(records, range(3)),
        moments=(None,) * 3,
        images=("b.jpg", "a.jpg", "b.jpg"),
    )
    frames = played_frames(some)
    assert [(frame.label, frame.rows) for frame in frames] == [("b.jpg", (0, 2)), ("a.jpg", (1,))]


def test_meshes_are_those_of_the_hand_model_on_the_right_side(
    records: HandRecords, hand: HandModel
) -> None:
    found = posed(records, hand).vertices
    expected = [in_camera(motion, hand).vertices.numpy() for motion in clip_hands()]
    np.testing.assert_allclose(found, np.concatenate(expected), atol=2e-6)


def test_hands_of_another_model_are_refused(records: HandRecords, hand: HandModel) -> None:
    of_mano = replace(records, hand_models=("mano",) * len(records))
    with pytest.raises(ValueError, match=r"hands of the hand model mano.*Start it with hand=mano"):
        posed(of_mano, hand)
