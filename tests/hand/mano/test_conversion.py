"""Conversion of MANO downloads: exact arrays, errors for other files, no overwriting."""

import hashlib
import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from safetensors import safe_open

from hand_recon.hand.mano.conversion import KEYS, convert_pickle, prepare_mano
from hand_recon.hand.mano.inert_pickle import RefusedPickleError
from hand_recon.hand.mano.store import FORMAT, file_name, read_mano
from tests.support.mano_file import RING_IDS, mano_arrays, mano_pickle, write_mano_pickle

DATA = Path(os.environ.get("HAND_RECON_DATA", "data"))


def zipped(path: Path, entries: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return path


def release(path: Path) -> Path:
    """Archive with the layout of MANO's download."""
    return zipped(
        path,
        {
            "mano_v1_2/LICENSE.txt": b"terms",
            "mano_v1_2/models/MANO_LEFT.pkl": mano_pickle(mano_arrays("left")),
            "mano_v1_2/models/MANO_RIGHT.pkl": mano_pickle(mano_arrays("right")),
            "mano_v1_2/models/SMPLH_male.pkl": b"not read",
            "__MACOSX/mano_v1_2/models/MANO_RIGHT.pkl": b"not read either",
            "../../escape.txt": b"not unpacked",
        },
    )


def changed(**changes: object) -> bytes:
    return mano_pickle(mano_arrays() | changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("side", ["right", "left"])
def test_every_array_is_stored_exactly(side: str, tmp_path: Path) -> None:
    source = tmp_path / f"MANO_{side.upper()}.pkl"
    expected = write_mano_pickle(source, side)
    (path,) = prepare_mano(source, tmp_path / "mano")
    assert path == tmp_path / "mano" / f"MANO_{side.upper()}.safetensors"
    file = read_mano(path, side)  # type: ignore[arg-type]
    for name, key in KEYS.items():
        np.testing.assert_array_equal(getattr(file.arrays, name), expected[key], err_msg=key)
    assert file.side == side
    assert file.source_sha256 == hashlib.sha256(source.read_bytes()).hexdigest()


def test_both_hands_of_the_archive_are_written_and_nothing_else(tmp_path: Path) -> None:
    source = release(tmp_path / "mano_v1_2.zip")
    paths = prepare_mano(source, tmp_path / "deep" / "mano")
    assert [path.name for path in paths] == [file_name("right"), file_name("left")]
    written = sorted(path for path in tmp_path.rglob("*") if path.is_file())
    assert written == sorted([source, *paths])


def test_a_cap_on_the_wrist_ring_closes_the_surface_with_faces_outwards(tmp_path: Path) -> None:
    prepare_mano(release(tmp_path / "mano.zip"), tmp_path)
    for side in ("right", "left"):
        arrays = read_mano(tmp_path, side).arrays
        ring, points = arrays.wrist_ring, arrays.template
        fan = np.stack([ring, np.roll(ring, -1), np.full(16, len(points))], axis=1)
        closed = trimesh.Trimesh(
            np.vstack([points, points[ring].mean(axis=0)]),
            np.vstack([arrays.faces, fan]),
            process=False,
        )
        assert closed.is_watertight
        assert closed.is_winding_consistent
        assert closed.volume > 1e-4


def test_the_ring_is_the_one_that_others_list_for_mano() -> None:
    """Vertices in the order around the ring; the starting vertex is arbitrary."""
    ring = convert_pickle(mano_pickle(mano_arrays()), "MANO_RIGHT.pkl").arrays.wrist_ring.tolist()
    begin = ring.index(RING_IDS[0])
    assert tuple(ring[begin:] + ring[:begin]) == RING_IDS


def test_faces_that_point_inwards_are_reversed() -> None:
    arrays = mano_arrays()
    as_usual = convert_pickle(mano_pickle(arrays), "MANO_RIGHT.pkl").arrays
    inwards = convert_pickle(changed(f=arrays["f"][:, ::-1].copy()), "MANO_RIGHT.pkl").arrays
    np.testing.assert_array_equal(inwards.faces, as_usual.faces)
    np.testing.assert_array_equal(inwards.wrist_ring, as_usual.wrist_ring)


def test_without_a_side_in_the_name_the_fingers_decide() -> None:
    assert convert_pickle(mano_pickle(mano_arrays("left")), "hand.pkl").side == "left"
    assert convert_pickle(mano_pickle(mano_arrays("right")), "hand.pkl").side == "right"


def test_a_hand_under_the_other_hands_name_is_refused(tmp_path: Path) -> None:
    source = tmp_path / "MANO_LEFT.pkl"
    write_mano_pickle(source, "right")
    with pytest.raises(
        ValueError, match="named as the left hand, but its fingers point as the right"
    ):
        prepare_mano(source, tmp_path)


def test_files_saved_without_chumpy_and_without_spare_keys_are_the_same_hand() -> None:
    arrays = mano_arrays()
    needed = {key: arrays[key] for key in (*KEYS.values(), "kintree_table")}
    plain = convert_pickle(pickle.dumps(needed), "MANO_RIGHT_np.pkl")
    original = convert_pickle(mano_pickle(arrays), "MANO_RIGHT.pkl")
    for name in KEYS:
        np.testing.assert_array_equal(
            getattr(plain.arrays, name), getattr(original.arrays, name), err_msg=name
        )


def test_of_more_than_ten_shape_directions_the_first_ten_are_kept() -> None:
    arrays = mano_arrays()
    spare = np.concatenate([arrays["shapedirs"], np.ones((778, 3, 10))], axis=2)
    found = convert_pickle(changed(shapedirs=spare), "MANO_RIGHT.pkl").arrays.shape_directions
    np.testing.assert_array_equal(found, arrays["shapedirs"])


def test_converting_again_changes_nothing(tmp_path: Path) -> None:
    source = release(tmp_path / "mano.zip")
    paths = prepare_mano(source, tmp_path)
    before = [(path.stat().st_ino, path.stat().st_mtime_ns) for path in paths]
    assert prepare_mano(source, tmp_path) == paths
    assert [(path.stat().st_ino, path.stat().st_mtime_ns) for path in paths] == before


def test_an_existing_file_of_another_hand_is_not_overwritten(tmp_path: Path) -> None:
    source, other = tmp_path / "MANO_RIGHT.pkl", tmp_path / "other_right.pkl"
    write_mano_pickle(source)
    write_mano_pickle(other, seed=1)
    (path,) = prepare_mano(source, tmp_path)
    before = path.read_bytes()
    with pytest.raises(FileExistsError, match=r"holds another hand.*Nothing was changed"):
        prepare_mano(other, tmp_path)
    assert path.read_bytes() == before


def test_beside_the_right_hand_a_left_hand_is_released_or_corrected(
    tmp_path: Path,
) -> None:
    left, mended = tmp_path / "MANO_LEFT.pkl", tmp_path / "mended_left.pkl"
    arrays = write_mano_pickle(left, "left")
    arrays["shapedirs"][:, 0] *= -1
    mended.write_bytes(mano_pickle(arrays))
    right = tmp_path / "MANO_RIGHT.pkl"
    write_mano_pickle(right)
    states = {}
    for name, sources in {
        "alone": [left],
        "after the right": [right, left],
        "mended": [right, mended],
    }.items():
        for source in sources:
            prepare_mano(source, tmp_path / name)
        states[name] = read_mano(tmp_path / name, "left").left_shape
    assert states == {"alone": "unknown", "after the right": "released", "mended": "corrected"}


def _html(folder: Path) -> Path:
    path = folder / "MANO_RIGHT.pkl"
    path.write_bytes(b"<!DOCTYPE html><title>Log in</title>")
    return path


def _body(folder: Path) -> Path:
    path = folder / "SMPL_NEUTRAL.pkl"
    path.write_bytes(pickle.dumps({"v_template": np.zeros((6890, 3)), "f": np.zeros((13776, 3))}))
    return path


def _mean_parameters(folder: Path) -> Path:
    path = folder / "mano_mean_params.npz"
    np.savez(path, pose=np.zeros(96), shape=np.zeros(10), cam=np.zeros(3))
    return path


def _processed(folder: Path) -> Path:
    path = folder / "processed_mano.pkl"
    path.write_bytes(pickle.dumps({"J_regressor_right": np.zeros((21, 778)), "weights_right": 0}))
    return path


def _wrong_archive(folder: Path) -> Path:
    return zipped(folder / "smpl.zip", {"smpl/models/basicmodel_m.pkl": b""})


def _twice(folder: Path) -> Path:
    return zipped(folder / "two.zip", {"a/MANO_RIGHT.pkl": b"", "b/MANO_RIGHT.pkl": b""})


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (_html, "cannot be read as a pickle"),
        (_body, r"is SMPL or SMPL\+H, a body \(6890 vertices\): not MANO's hand.*mano_v1_2.zip"),
        (
            _mean_parameters,
            "NumPy arrays .*mano_mean_params.npz, and not the hand model.*mano_v1_2",
        ),
        (_processed, r"holds \['J_regressor_right', 'weights_right'\] without .*not MANO's hand"),
        (_wrong_archive, r"holds no MANO_RIGHT\.pkl, expected one MANO_RIGHT\.pkl"),
        (_twice, r"holds \['a/MANO_RIGHT.pkl', 'b/MANO_RIGHT.pkl'\], expected one"),
    ],
)
def test_another_file_is_refused_with_what_it_holds_and_what_is_expected(
    make: Callable[[Path], Path], says: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=says):
        prepare_mano(make(tmp_path), tmp_path / "mano")
    assert not (tmp_path / "mano").exists()


def test_a_missing_source_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        FileNotFoundError, match=r"No file .*nothing\.zip\. Expected mano_v1_2\.zip"
    ):
        prepare_mano(tmp_path / "nothing.zip", tmp_path)


def _not_a_number() -> dict[str, object]:
    template = mano_arrays()["v_template"]
    template[5] = np.nan
    return {"v_template": template}


def _other_order() -> dict[str, object]:
    parents = mano_arrays()["kintree_table"].copy()
    parents[0, 3] = 1
    return {"kintree_table": parents}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (_not_a_number(), "v_template holds numbers that are not finite"),
        (_other_order(), "the order of joints is not MANO's"),
        ({"weights": mano_arrays()["weights"] * 1.1}, "rows of weights miss a sum of one by 0.1"),
        ({"posedirs": np.zeros((778, 3, 207))}, r"\(778, 3, 207\)\}, expected .*\(778, 3, 135\)"),
        ({"shapedirs": np.zeros((778, 3, 5))}, "'10 or more'"),
        (
            {"f": mano_arrays()["f"] + 1},
            "faces have vertex indices from 1 to 778, expected 0 to 777",
        ),
        ({"f": np.roll(mano_arrays()["f"], 5, axis=1)[:, [0, 0, 1]]}, "open edges"),
    ],
)
def test_a_damaged_hand_is_refused(changes: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        convert_pickle(changed(**changes), "MANO_RIGHT.pkl")


def test_an_array_that_holds_no_numbers_is_named() -> None:
    data = pickle.dumps(mano_arrays() | {"weights": "many"})
    with pytest.raises(RefusedPickleError, match="weights: a str holds no numbers"):
        convert_pickle(data, "MANO_RIGHT.pkl")


@pytest.mark.mano
def test_the_real_mano_is_read_and_closes_at_the_ring_that_others_list(tmp_path: Path) -> None:
    (path,) = prepare_mano(DATA / "mano" / "MANO_RIGHT.pkl", tmp_path)
    arrays = read_mano(path).arrays
    ring = arrays.wrist_ring.tolist()
    begin = ring.index(RING_IDS[0])
    assert tuple(ring[begin:] + ring[:begin]) == RING_IDS


def test_a_stored_file_says_its_format(tmp_path: Path) -> None:
    prepare_mano(release(tmp_path / "mano.zip"), tmp_path)
    with safe_open(tmp_path / file_name("left"), framework="numpy") as stored:
        metadata = stored.metadata()
    assert metadata["format"] == FORMAT
    assert metadata["side"] == "left"
    assert metadata["left_shape_directions"] == "released"
    assert len(metadata["source_sha256"]) == 64
