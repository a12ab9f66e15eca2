"""Places of images: folders, Parquet files and LeRobot's datasets."""

import json
from pathlib import Path

import pytest

pyarrow = pytest.importorskip("pyarrow")

from hand_recon.scale.places import Places, places_of  # noqa: E402
from hand_recon.scale.readers import ImageReader  # noqa: E402
from tests.support.lerobot_folder import (  # noqa: E402
    CAMERA,
    FPS,
    LENGTHS,
    version_2,
    version_3,
    write_images,
    write_info,
)
from tests.support.video_files import number_of  # noqa: E402


def numbers_of(places: Places) -> list[int]:
    """The number that each image shows."""
    read = ImageReader()
    rows = places.table.select(["path", "position"]).to_pylist()
    return [number_of(read({**row, "column": places.column}).pixels) for row in rows]


@pytest.mark.parametrize("version", ["v2", "v3", "v3 with images"])
def test_every_frame_of_a_dataset_is_found_once_and_in_order(version: str, tmp_path: Path) -> None:
    folder = tmp_path / "dataset"
    if version == "v2":
        version_2(folder)
        expected = [*range(LENGTHS[0]), *range(LENGTHS[1])]
    else:
        version_3(folder, videos=version == "v3")
        expected = list(range(sum(LENGTHS)))
    places = places_of([str(folder)], None)
    assert places.column == CAMERA
    assert numbers_of(places) == expected
    table = places.table.to_pydict()
    assert table["episode_index"] == [0] * LENGTHS[0] + [1] * LENGTHS[1]
    assert table["frame_index"] == [*range(LENGTHS[0]), *range(LENGTHS[1])]
    assert table["timestamp"] == pytest.approx([frame / FPS for frame in table["frame_index"]])


def test_a_dataset_that_is_not_clear_is_refused(tmp_path: Path) -> None:
    folder = version_2(tmp_path / "dataset")
    with pytest.raises(ValueError, match=f"has the cameras {CAMERA}; expected column=front among"):
        places_of([str(folder)], "front")
    with pytest.raises(ValueError, match="and 1 more input"):
        places_of([str(folder), "examples"], None)
    info = folder / "meta" / "info.json"
    known = json.loads(info.read_text())
    for change, told in (
        ({"codebase_version": "v1.6"}, "of the version v1.6; expected v2 or v3"),
        ({"features": {}}, "has no camera"),
        (
            {"features": known["features"] | {"front": {"dtype": "video"}}},
            "expected one of them with",
        ),
    ):
        info.write_text(json.dumps(known | change))
        with pytest.raises(ValueError, match=told):
            places_of([str(folder)], None)
    info.write_text("[1]")
    with pytest.raises(ValueError, match="has no features, fps, data_path"):
        places_of([str(folder)], None)
    empty = write_info(tmp_path / "empty", "v3.0", "video", data_path="d", video_path="v")
    with pytest.raises(ValueError, match="has no table in meta/episodes"):
        places_of([str(empty)], None)


def test_rows_of_parquet_files_are_places_in_natural_order(tmp_path: Path) -> None:
    for name, count in (("10.parquet", 2), ("9.parquet", 3)):
        write_images(tmp_path / name, count, "image", group=2)
    (tmp_path / "_metadata.parquet").write_bytes(b"")
    places = places_of([str(tmp_path)], None)
    assert places.column == "image"
    assert places.table["position"].to_pylist() == [0, 1, 2, 0, 1]
    assert numbers_of(places) == [0, 1, 2, 0, 1]
    assert [path.name for path in places.files] == ["9.parquet", "10.parquet"]
    with pytest.raises(ValueError, match="has the columns image, other, no column photo"):
        places_of([str(tmp_path)], "photo")


def test_photographs_and_tables_together_are_refused(tmp_path: Path) -> None:
    """Also a folder of photographs with a table about them beside: neither is lost without a word."""
    photos = tmp_path / "photos"
    photos.mkdir()
    # A photograph is known by its contents, too.
    photo, table = photos / "front", photos / "metadata.parquet"
    photo.write_bytes(Path("examples/hand.jpg").read_bytes())
    write_images(table, 2, "image", group=2)
    for given in ([str(photo), str(table)], [str(photos)], [str(table), str(photos)]):
        told = rf"Found the Parquet file {table} and {photo}; expected either .* Run the command for each"
        with pytest.raises(ValueError, match=told):
            places_of(given, None)
    assert len(places_of([str(table)], None)) == 2
    assert len(places_of([str(photo)], None)) == 1


def test_results_below_the_photographs_are_no_input(tmp_path: Path) -> None:
    """Such as those of the same command, interrupted, or of an earlier one."""
    photos, output = tmp_path / "photos", tmp_path / "photos" / "out"
    (output / "hands").mkdir(parents=True)
    (photos / "a.jpg").write_bytes(Path("examples/hand.jpg").read_bytes())
    write_images(output / "hands" / "part-00000.parquet", 2, "path", group=2)
    with pytest.raises(ValueError, match="expected either Parquet files or photographs"):
        places_of([str(photos)], None)
    assert places_of([str(photos)], None, output).column is None
    (output / "unfinished.json").write_text("{}")
    assert len(places_of([str(photos)], None, tmp_path / "other")) == 1
    (output / "unfinished.json").unlink()
    (output / "manifest.json").write_text(json.dumps({"rows_of_a_part": 2}))
    assert len(places_of([str(photos)], None)) == 1
    # A dataset with a manifest of its own is an input, and so are results that are named.
    (photos / "a.jpg").unlink()
    assert places_of([str(output)], None).column == "path"
    (output / "manifest.json").write_text(json.dumps({"files": []}))
    assert places_of([str(photos)], None).column == "path"


def test_results_in_the_folder_of_the_photographs_themselves_are_no_input(tmp_path: Path) -> None:
    (tmp_path / "hands").mkdir()
    (tmp_path / "unfinished.json").write_text("{}")
    (tmp_path / "a.jpg").write_bytes(Path("examples/hand.jpg").read_bytes())
    write_images(tmp_path / "hands" / "part-00000.parquet", 2, "path", group=2)
    places = places_of([str(tmp_path)], None, tmp_path)
    assert [path.name for path in places.files] == ["a.jpg"]


def test_a_table_without_images_is_told_its_columns(tmp_path: Path) -> None:
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table({"a": [1]}), tmp_path / "a.parquet")
    with pytest.raises(ValueError, match=r"has the columns a, none of the usual names"):
        places_of([str(tmp_path / "a.parquet")], None)
    (tmp_path / "b.parquet").write_bytes(b"PAR1")
    with pytest.raises(ValueError, match=r"b\.parquet cannot be read as Parquet"):
        places_of([str(tmp_path / "b.parquet")], "a")


def test_the_state_of_an_input_changes_with_its_files(tmp_path: Path) -> None:
    for name in ("a.jpg", "b.jpg"):
        (tmp_path / name).write_bytes(Path("examples/hand.jpg").read_bytes())
    first = places_of([str(tmp_path)], None).state()
    assert first == places_of([str(tmp_path)], None).state()
    assert first["images"] == 2
    (tmp_path / "b.jpg").write_bytes(b"\xff\xd8\xff")
    assert places_of([str(tmp_path)], None).state() != first
    with pytest.raises(ValueError, match="column=image and photographs"):
        places_of([str(tmp_path)], "image")
