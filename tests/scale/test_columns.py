"""Columns of Daft: the three functions, in processes of their own."""

from pathlib import Path

import numpy as np
import pytest

daft = pytest.importorskip("daft", reason="Daft (the extra scale) is not installed")

import hand_recon  # noqa: E402
from hand_recon.hand.model import HandModel  # noqa: E402
from hand_recon.scale import audit_hands, fit_hands, reconstruct_hands  # noqa: E402
from tests.support.daft_processes import in_processes  # noqa: E402
from tests.support.photo_folder import QUICK, photo_folder  # noqa: E402

THEIRS = {
    "handedness": daft.DataType.string(),
    "confidence": daft.DataType.float32(),
    "kp2d": daft.DataType.list(daft.DataType.list(daft.DataType.float32())),
    "kp3d": daft.DataType.list(daft.DataType.list(daft.DataType.float32())),
}
"""Fields of a hand in daft-physical-ai 0.3, in their order."""


def test_a_hand_begins_with_the_fields_of_daft_physical_ai() -> None:
    frame = daft.from_pydict({"image": ["a.jpg"]})
    column = frame.select(reconstruct_hands(frame["image"]).alias("found")).schema()["found"].dtype
    assert list(column.fields) == ["hands", "width", "height", "error"]
    hand = column.fields["hands"].dtype
    assert dict(list(hand.fields.items())[:4]) == THEIRS


def test_settings_are_refused_before_anything_runs() -> None:
    frame = daft.from_pydict({"image": ["a.jpg"]})
    with pytest.raises(ValueError, match=r"'output=x' has no effect here: .*reconstruct_hands"):
        reconstruct_hands(frame["image"], overrides=["output=x"])
    with pytest.raises(ValueError, match="workers=0; expected 1 or more"):
        fit_hands(frame["image"], workers=0)
    with pytest.raises(ValueError, match="'files=x' has no effect here"):
        audit_hands(frame["image"], overrides=["files=x"])


@pytest.mark.slow
@in_processes
def test_2d_landmarks_become_3d_hands_and_verdicts_in_one_table(
    hand: HandModel, tmp_path: Path
) -> None:
    folder = photo_folder(hand, tmp_path)
    given = hand_recon.read_landmarks(folder / "found.json").landmarks_2d.numpy()[:2]
    frame = daft.from_pydict(
        {"points": [*given.tolist(), None], "side": ["right", "right", "left"]}
    )
    frame = frame.with_column(
        "fit", fit_hands(frame["points"], side=frame["side"], overrides=QUICK)
    )
    kp3d = frame["fit"].get("hand").get("kp3d")
    frame = frame.with_column("audit", audit_hands(kp3d, side="right"))
    rows = frame.to_pylist()
    expected = hand_recon.fit_landmarks(given, side="right", overrides=QUICK)
    for row, own in zip(rows, expected.landmarks_3d, strict=False):
        np.testing.assert_allclose(row["fit"]["hand"]["kp3d"], own, atol=1e-5)
        assert row["audit"]["error"] is None
        assert row["audit"]["verdict"] in ("plausible", "implausible")
    assert "landmarks are null" in rows[2]["fit"]["error"]
    assert "landmarks are null" in rows[2]["audit"]["error"]


@pytest.mark.slow
@in_processes
def test_images_of_every_form_become_the_hands_of_the_command(
    hand: HandModel, tmp_path: Path
) -> None:
    folder = photo_folder(hand, tmp_path)
    photo = folder / "photos" / "1 two.png"
    words = ["detector=landmarks", f"detector.landmarks='{folder}/found.json'", *QUICK]
    image = {"bytes": photo.read_bytes(), "path": str(photo)}
    frame = daft.from_pydict({"image": [image, {"bytes": b"\xff\xd8\xff", "path": None}]})
    found = reconstruct_hands(frame["image"], workers=2, batch=1, overrides=words)
    rows = frame.with_column("found", found).to_pylist()
    expected = hand_recon.reconstruct(photo, overrides=words)
    hands = rows[0]["found"]["hands"]
    np.testing.assert_allclose([one["kp3d"] for one in hands], expected.landmarks_3d, atol=1e-5)
    assert "damaged JPEG" in rows[1]["found"]["error"] or "cut off" in rows[1]["found"]["error"]
