"""Packed hands: labels and pixels that survive the file, and what it refuses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from gpu.pack import encode, main
from gpu.packed import PackedHands, group_of, read_packed
from gpu.resident import decode, load, resized
from hand_recon.data.annotated_dataset import AnnotatedImages
from hand_recon.data.crop import CropPolicy
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits
from tests.support.smooth_photos import hands_folder

SIZE = 64
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return hands_folder(tmp_path_factory.mktemp("photos"))


@pytest.fixture(scope="module")
def carried(photos: Path) -> Path:
    folder = photos / "carried"
    main(
        [
            str(photos / "train.json"), "--test", str(photos / "test.json"), "--out", str(folder),
            "--size", str(SIZE), "--quality", "95", "--hands-in-3d", "easy:2",
        ]
    )  # fmt: skip
    return folder


def split(photos: Path, name: str) -> AnnotatedImages:
    recipe = LandmarkRecipe(
        photos / "train.json", test=photos / "test.json", crop=CropPolicy(SIZE, "joints", 1.5)
    )
    return LandmarkSplits(recipe).dataset(name)


def test_labels_and_pixels_survive_packing(photos: Path, carried: Path) -> None:
    packed = read_packed(carried / "hands.npz")
    assert (len(packed), packed.test.tolist()) == (6, [False] * 4 + [True] * 2)
    assert packed.landmark_set == "mediapipe"
    resident = load(packed, np.flatnonzero(packed.test), SIZE, CPU)
    for index, sample in enumerate(split(photos, "test")[place] for place in range(2)):
        assert resident.names[index] == sample.source
        error = (resident.landmarks_2d[index] - sample.landmarks_2d).abs()
        assert float(error.amax()) <= 0.005 + 1e-4
        outside = sample.image.amax(dim=0) == 0
        assert torch.equal(resident.images[index].amax(dim=0) == 0, outside)
        # Interpolation darkens the border to the black outside, which the codec blurs.
        inside = torch.nn.functional.max_pool2d(outside[None].float(), 5, 1, 2)[0] == 0
        difference = resident.images[index].float() - sample.image.float()
        assert float(difference[:, inside].abs().mean()) < 2.5


def test_groups_are_the_first_folders(carried: Path) -> None:
    names = read_packed(carried / "hands.npz").names
    assert {group_of(name) for name in names} == {"waves", "fists"}
    assert (group_of("photo.jpg"), group_of("a/b/c.jpg")) == ("", "a")


def test_labels_follow_the_size_that_is_wanted(carried: Path) -> None:
    packed = read_packed(carried / "hands.npz")
    rows = np.arange(len(packed))
    small, large = load(packed, rows, SIZE, CPU), load(packed, rows, 2 * SIZE, CPU)
    assert large.images.shape[-1] == 2 * SIZE
    torch.testing.assert_close(large.landmarks_2d, 2 * small.landmarks_2d)
    # The mean colour of a patch is the same in both.
    halved = resized(large.images, SIZE).float()
    assert float((halved - small.images.float()).abs().mean()) < 2.0


def test_rendered_hands_bring_their_3d(carried: Path) -> None:
    packed = read_packed(carried / "hands_in_3d.npz")
    assert packed.landmarks_3d is not None
    assert packed.landmarks_3d.shape == (2, 21, 3)
    assert (packed.landmarks_3d[..., 2] > 0).all()
    resident = load(packed, np.arange(2), SIZE, CPU)
    assert resident.batch(torch.tensor([1, 0])).landmarks_3d is not None
    assert read_packed(carried / "hands.npz").landmarks_3d is None


@given(st.integers(0, 20), st.integers(0, 20), st.integers(1, 12), st.integers(1, 12))
def test_the_corner_is_that_of_the_part_that_is_not_black(
    left: int, top: int, width: int, height: int
) -> None:
    pixels = np.zeros((3, 32, 32), np.uint8)
    pixels[:, top : top + height, left : left + width] = 200
    corner, content = encode(pixels, 90)
    assert corner == (left, top)
    assert decode(content).shape == (3, height, width)


def test_a_black_crop_can_be_packed() -> None:
    corner, content = encode(np.zeros((3, 8, 8), np.uint8), 90)
    assert (corner, decode(content).shape) == ((0, 0), (3, 1, 1))


def hands(**columns: object) -> PackedHands:
    """Two hands without anything to see."""
    _, content = encode(np.full((3, 8, 8), 99, np.uint8), 90)
    plain = PackedHands(
        size=8,
        landmark_set="knuckle",
        names=("a/1", "a/2"),
        test=np.array([False, True]),
        landmarks_2d=np.full((2, 21, 2), 3.0, np.float32),
        corners=np.zeros((2, 2), np.int64),
        images=(content, content),
    )
    return replace(plain, **columns)  # type: ignore[arg-type]


def test_a_missing_label_stays_missing(tmp_path: Path) -> None:
    points = np.full((2, 21, 2), -7.25, np.float32)
    points[0, 3] = np.nan
    hands(landmarks_2d=points).write(tmp_path / "hands.npz")
    found = read_packed(tmp_path / "hands.npz")
    np.testing.assert_allclose(found.landmarks_2d, points, atol=1e-5)
    resident = load(found, np.arange(2), 8, CPU)
    assert resident.labelled.sum(dim=1).tolist() == [20, 21]


def test_columns_of_other_lengths_and_far_labels_are_refused() -> None:
    with pytest.raises(ValueError, match=r"lengths \[1, 2\]; expected one"):
        hands(names=("a",))
    with pytest.raises(ValueError, match="more than 328 pixels from its crop's corner"):
        hands(landmarks_2d=np.full((2, 21, 2), 400.0, np.float32))


def test_files_that_are_not_packed_hands_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No packed hands at .*python -m gpu\.pack"):
        read_packed(tmp_path / "hands.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(ValueError, match="format None; expected 'hand_recon packed hands 1'"):
        read_packed(tmp_path / "other.npz")


def test_hands_with_fingers_of_others_are_for_training_alone(photos: Path, tmp_path: Path) -> None:
    words = [
        str(photos / "train.json"),
        "--test",
        str(photos / "test.json"),
        "--out",
        str(tmp_path),
    ]
    main([*words, "--size", "48", "--exchanged", "3"])
    packed = read_packed(tmp_path / "hands.npz")
    assert packed.test.tolist() == [False] * 4 + [True] * 2 + [False] * 3
    assert all("exchanged fingers" in name for name in packed.names[6:])
    assert {group_of(name) for name in packed.names[6:]} == {""}
    assert np.isfinite(packed.landmarks_2d).all()


def test_a_file_that_is_too_large_is_said_to_be(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gpu.pack.LIMIT_MIB", 0.001)
    with pytest.raises(SystemExit, match=r"expected at most 0\.001\. Lower --quality or --size"):
        main([str(photos / "train.json"), "--out", str(tmp_path), "--size", "48"])
