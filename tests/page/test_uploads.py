"""Files from a browser: their kinds, their names, and the folder that no message shows."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.fitting.hand_entry import KEYS
from hand_recon.page.uploads import safe_name, saved, upload_kind

JPEG = (Path(__file__).parents[2] / "examples" / "hand.jpg").read_bytes()
HANDS = json.dumps([dict.fromkeys(KEYS)]).encode()


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("hand.jpg", JPEG, "photo"),
        ("hand.json", JPEG, "landmarks"),
        ("hand", JPEG, "photo"),
        ("a.jpg", b"[[1, 2]]", "landmarks"),
        ("points.csv", b"u,v\n1,2\n", "landmarks"),
        ("points.npy", np.zeros((21, 2)).tobytes(), "landmarks"),
        ("hands.json", HANDS, "hands"),
        ("hands.jsonl", json.dumps(dict.fromkeys(KEYS)).encode() + b"\n" * 3, "hands"),
        ("hands.txt", b"\n " + HANDS, "hands"),
        ("deep.json", b"[" * 100_000, "landmarks"),
        ("empty.bin", b"", "photo"),
    ],
)
def test_a_file_is_told_by_its_content_before_its_name(
    name: str, content: bytes, kind: str
) -> None:
    assert upload_kind(name, content) == kind


@given(st.text(max_size=150))
def test_every_name_becomes_the_name_of_one_file(name: str) -> None:
    safe = safe_name(name)
    assert Path(safe).name == safe
    # File systems count bytes, of which a letter may have four.
    assert 0 < len(safe.encode()) <= 120
    assert not {"/", "\\", "\0"} & set(safe)


def test_folders_of_a_name_are_left_out() -> None:
    assert safe_name("../../etc/pass\0wd.jpg") == "passwd.jpg"
    assert safe_name("C:\\photos\\hånd's, [left].png") == "hånd's, [left].png"
    assert safe_name("..") == "file"
    assert safe_name("手" * 90 + ".jpg") == "手" * 33 + ".jpg"


def test_a_saved_file_is_gone_afterwards_and_its_folder_is_in_no_message() -> None:
    with saved("hand.jpg", b"content") as path:
        assert path.read_bytes() == b"content"
        folder = path.parent
    assert not folder.exists()
    with (
        pytest.raises(ValueError, match=r"^hand\.jpg is damaged, see hand\.jpg$"),
        saved("hand.jpg", b"") as path,
    ):
        raise OSError(f"{path} is damaged, see {path}")
    assert not path.exists()
