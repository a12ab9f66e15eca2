"""DexYCB's setups: members and order of each part, against the rules written out by hand."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from hand_recon.data.dexycb.files import SERIALS, SUBJECTS, Grasp, image_path, read_grasps
from hand_recon.data.dexycb.splits import enumerate_frames, split_named

RULES: dict[tuple[str, str], tuple[list[int], Callable[[int], bool], list[int]]] = {
    ("s0", "train"): (list(range(10)), lambda i: i % 5 != 4, list(range(8))),
    ("s0", "val"): ([0, 1], lambda i: i % 5 == 4, list(range(8))),
    ("s0", "test"): ([2, 3, 4, 5, 6, 7, 8, 9], lambda i: i % 5 == 4, list(range(8))),
    ("s1", "train"): ([0, 1, 2, 3, 4, 5, 9], lambda _: True, list(range(8))),
    ("s1", "val"): ([6], lambda _: True, list(range(8))),
    ("s1", "test"): ([7, 8], lambda _: True, list(range(8))),
    ("s2", "train"): (list(range(10)), lambda _: True, [0, 1, 2, 3, 4, 5]),
    ("s2", "val"): (list(range(10)), lambda _: True, [6]),
    ("s2", "test"): (list(range(10)), lambda _: True, [7]),
    ("s3", "train"): (list(range(10)), lambda i: i // 5 not in (3, 7, 11, 15, 19), list(range(8))),
    ("s3", "val"): (list(range(10)), lambda i: i // 5 in (3, 19), list(range(8))),
    ("s3", "test"): (list(range(10)), lambda i: i // 5 in (7, 11, 15), list(range(8))),
}
"""Subjects, sequences and cameras of each part."""

SIZES = {
    ("s0", "train"): 6400, ("s0", "val"): 320, ("s0", "test"): 1280,
    ("s1", "train"): 5600, ("s1", "val"): 800, ("s1", "test"): 1600,
    ("s2", "train"): 6000, ("s2", "val"): 1000, ("s2", "test"): 1000,
    ("s3", "train"): 6000, ("s3", "val"): 800, ("s3", "test"): 1200,
}  # fmt: skip
"""With one frame in every sequence: subjects × sequences × cameras, by hand."""


def grasp(subject: int, index: int, frames: int) -> Grasp:
    return Grasp(subject, index, Path(SUBJECTS[subject]) / f"{index}", frames, False, "none")


def of_subjects(subjects: tuple[int, ...], frames: Callable[[int, int], int]) -> list[Grasp]:
    return [grasp(s, index, frames(s, index)) for s in subjects for index in range(100)]


def slowly(
    key: tuple[str, str], frames: Callable[[int, int], int]
) -> list[tuple[int, int, int, int]]:
    """Subject, sequence, camera and frame of every id, in order."""
    subjects, belongs, cameras = RULES[key]
    return [
        (subject, index, camera, frame)
        for subject in subjects
        for index in range(100)
        if belongs(index)
        for camera in cameras
        for frame in range(frames(subject, index))
    ]


@pytest.mark.parametrize("key", list(RULES))
def test_each_part_has_the_members_and_the_order_of_the_toolkit(key: tuple[str, str]) -> None:
    def frames(subject: int, index: int) -> int:
        return (7 * subject + 3 * index) % 4

    split = split_named(*key)
    found = enumerate_frames(split, of_subjects(split.subjects, frames))
    grasps = [found.grasps[index] for index in found.grasp.tolist()]
    listed = zip(grasps, found.camera.tolist(), found.number.tolist(), strict=True)
    assert [(g.subject, g.index, camera, frame) for g, camera, frame in listed] == slowly(
        key, frames
    )


@pytest.mark.parametrize("key", list(RULES))
def test_sizes_are_subjects_times_sequences_times_cameras(key: tuple[str, str]) -> None:
    split = split_named(*key)
    assert len(enumerate_frames(split, of_subjects(split.subjects, lambda *_: 1))) == SIZES[key]


@pytest.mark.parametrize("setup", ["s0", "s1", "s2", "s3"])
def test_the_parts_of_a_setup_share_no_image(setup: str) -> None:
    images: list[Path] = []
    for part in ("train", "val", "test"):
        split = split_named(setup, part)
        frames = enumerate_frames(split, of_subjects(split.subjects, lambda *_: 1))
        rows = zip(
            frames.grasp.tolist(), frames.camera.tolist(), frames.number.tolist(), strict=True
        )
        images += [image_path(frames.grasps[g], camera, number) for g, camera, number in rows]
    assert len(set(images)) == len(images) == sum(SIZES[setup, p] for p in ("train", "val", "test"))


def write_metas(root: Path, count: int = 100) -> Path:
    """A subject's sequences without images or labels, the last one first."""
    folder = root / SUBJECTS[3]
    for index in reversed(range(count)):
        sequence = folder / f"20200903_{100000 + 7 * index}"
        sequence.mkdir(parents=True)
        meta = {"num_frames": 60 + index, "mano_sides": ["left" if index % 3 == 0 else "right"],
                "mano_calib": [f"c{index}"], "serials": list(SERIALS)}  # fmt: skip
        (sequence / "meta.yml").write_text(yaml.safe_dump(meta))
    return folder


def test_sequences_are_counted_in_sorted_order_and_strays_are_not(tmp_path: Path) -> None:
    folder = write_metas(tmp_path)
    (folder / ".DS_Store").write_text("")
    (folder / "00000000_000000").write_text("a file")
    (folder / "a_folder").mkdir()
    grasps = read_grasps(tmp_path, 3)
    assert [grasp.index for grasp in grasps] == list(range(100))
    assert [grasp.frames for grasp in grasps] == [60 + index for index in range(100)]
    assert [grasp.left for grasp in grasps] == [index % 3 == 0 for index in range(100)]
    # No label was opened for the size: there is none. 80 sequences of 60 + i frames, eight cameras.
    sequences = [index for index in range(100) if index % 5 != 4]
    assert len(enumerate_frames(split_named("s0", "train"), grasps)) == 8 * sum(
        60 + i for i in sequences
    )


@pytest.mark.parametrize(("count", "error"), [(99, FileNotFoundError), (101, ValueError)])
def test_another_number_of_sequences_would_shift_the_splits(
    tmp_path: Path, count: int, error: type[Exception]
) -> None:
    write_metas(tmp_path, count)
    with pytest.raises(
        error, match=rf"holds {count} sequences .*expected 100: the position of each"
    ):
        read_grasps(tmp_path, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mano_sides": ["both"]}, r"mano_sides: \['both'\], expected \[right\] or \[left\]"),
        ({"num_frames": "many"}, "num_frames: 'many', expected a whole number"),
        ({"mano_calib": []}, r"mano_calib: \[\], expected the name"),
    ],
)
def test_a_meta_file_that_is_not_dexycbs_is_named(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    path = write_metas(tmp_path) / "20200903_100007" / "meta.yml"
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | change))
    with pytest.raises(ValueError, match=rf"20200903_100007/meta.yml has {message}"):
        read_grasps(tmp_path, 3)


def test_a_split_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match=r"Unknown split 's4' 'train'; the setups are"):
        split_named("s4", "train")
