"""`predict rank=uncertainty`: the list of photographs to annotate next."""

import json
import shutil
from pathlib import Path

import pytest

from hand_recon.runs.predict_run import predict
from tests.support.photo_folder import asked, table


def test_photographs_are_listed_in_the_order_in_which_labels_help(folder: Path) -> None:
    """A photograph that is there twice is listed early and late; one that is cut off is not."""
    photos = folder / "photos"
    shutil.copy(photos / "1 two.png", photos / "0 the same.png")
    entries = (folder / "found.json").read_text(encoding="utf-8")
    again = entries.replace('"1 two.png"', '"0 the same.png"').strip("[]")
    (folder / "found.json").write_text(f"[{again}, {entries.strip('[]')}]", encoding="utf-8")
    with pytest.raises(ValueError, match="1 of 5 images could not be processed"):
        predict(asked(folder, "rank=uncertainty"))
    rows = table(folder / "out" / "to_annotate.csv")
    assert [row["place"] for row in rows] == ["1", "2", "3", "4"]
    names = [row["image"] for row in rows]
    assert sorted(names) == ["0 the same.png", "1 two.png", "2 none.png", "3 hånd's, [left].png"]
    gains = [float(row["gain_mm"]) for row in rows]
    assert gains == sorted(gains, reverse=True)
    last = rows[-1]
    twins = {"0 the same.png": "1 two.png", "1 two.png": "0 the same.png"}
    assert last["reason"].endswith(f"Like {twins[last['image']]}, which is listed before.")
    assert float(last["gain_mm"]) < 0.1 < 1 < float(last["value_mm"])
    reasons = {row["image"]: row["reason"] for row in rows}
    assert reasons["2 none.png"] == "No hand was found: label it if there is one."
    assert "left hand is uncertain by" in reasons["3 hånd's, [left].png"]


def test_without_being_asked_there_is_no_list(folder: Path) -> None:
    (folder / "photos" / "4 cut off.png").unlink()
    predict(asked(folder))
    assert not (folder / "out" / "to_annotate.csv").exists()


def test_a_list_needs_a_folder(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"no output; to_annotate\.csv is written to a folder"):
        predict(asked(folder, "rank=uncertainty", "json=-", "output=null"))
    assert not (folder / "out").exists()


def test_error_bars_are_those_that_are_asked_for(folder: Path) -> None:
    """Without the correction, the variances of all landmarks are smaller, and the hands are the same."""
    (folder / "photos" / "4 cut off.png").unlink()
    found = []
    for name, words in (("living", ()), ("laplace", ("descent.error_bars=laplace",))):
        predict(asked(folder, *words, f"output='{folder / name}'"))
        found.append(json.loads((folder / name / "hands.json").read_text(encoding="utf-8")))
    for corrected, plain in zip(*found, strict=True):
        assert corrected["landmarks_3d"] == plain["landmarks_3d"]
        for one, other in zip(corrected["covariance_3d"], plain["covariance_3d"], strict=True):
            assert all(one[axis][axis] > other[axis][axis] for axis in range(3))
