"""Datasets with exchanged fingers: order, repeatability, the cache, and what cannot be exchanged."""

import itertools
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.finger_exchange import FINGERS, straight_fingers
from hand_recon.data.landmarks.datamodule import LandmarkDataModule
from hand_recon.data.landmarks.exchanged import WithExchangedFingers

OPEN = [[60, 100], *[[30 - 8 * k, 82 - 9 * k] for k in range(4)]] + [
    [34 + 11 * finger, 62 - 12 * k] for finger in range(1, 5) for k in range(4)
]
"""An open hand, seen from its palm."""


def folder_of(path: Path, hands: int) -> Path:
    """Photographs of made-up hands: open, with the little finger bent, or with the index finger bent."""
    labels = []
    for number in range(hands):
        points = np.array(OPEN, dtype=float)
        if number % 3:
            points[list(FINGERS[4 if number % 3 == 1 else 1]), 1] = 62, 50, 55, 63
        image = np.full((120, 120, 3), 60 + number, np.uint8)
        for joints in FINGERS:
            line = np.round(points[[0, *joints]]).astype(np.int32)
            cv2.polylines(image, [line], isClosed=False, color=(110, 150, 200), thickness=9)
        cv2.imwrite(str(path / f"{number}.png"), image)
        labels.append({"image": f"{number}.png", "landmarks": points.tolist(), "side": "right"})
    (path / "labels.json").write_text(json.dumps(labels))
    return path / "labels.json"


def data(path: Path, *, exchanged: int, hands: int = 12, workers: int = 2) -> LandmarkDataModule:
    labels = path / "labels.json"
    return LandmarkDataModule(
        labels if labels.is_file() else folder_of(path, hands),
        crop=CropPolicy(size=64, around="joints"),
        reading=ReadingPolicy(path / "cache", workers=workers),
        exchanged=exchanged,
    )


def test_further_hands_come_after_the_photographs_and_only_in_training(tmp_path: Path) -> None:
    plain, more = data(tmp_path, exchanged=0), data(tmp_path, exchanged=9)
    photographs, every = plain.dataset("train"), more.dataset("train")
    assert isinstance(every, WithExchangedFingers)
    assert len(every) == len(photographs) + 9
    for index in (0, len(photographs) - 1):
        assert torch.equal(every[index].image, photographs[index].image)
    last = every[len(every) - 1]
    assert last.index == len(every) - 1
    assert last.labelled.all()
    assert "exchanged" in last.source
    assert len(more.dataset("val")) == len(plain.dataset("val"))
    with pytest.raises(IndexError):
        every[len(every)]


def test_they_do_not_depend_on_threads_and_are_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = data(tmp_path, exchanged=9, workers=3).dataset("train")
    images = [first[len(first) - k - 1].image for k in range(9)]

    def refused(*arguments: object) -> None:
        raise AssertionError(arguments)

    with monkeypatch.context() as patched:
        patched.setattr("hand_recon.data.landmarks.exchanged._make", refused)
        again = data(tmp_path, exchanged=9).dataset("train")
    assert all(torch.equal(again[len(again) - k - 1].image, images[k]) for k in range(9))
    for cached in (tmp_path / "cache").rglob("exchanged-*"):
        if cached.is_dir():
            cached.rename(cached.with_name("elsewhere"))
    one = data(tmp_path, exchanged=9, workers=1).dataset("train")
    assert all(torch.equal(one[len(one) - k - 1].image, images[k]) for k in range(9))


def test_hands_come_about_that_no_photograph_shows(tmp_path: Path) -> None:
    every = data(tmp_path, exchanged=20).dataset("train")
    start = len(every) - 20
    photographs = [every[index].landmarks_2d for index in range(start)]
    shapes = [every[start + k].landmarks_2d for k in range(20)]
    # Index and little finger bent, a quarter of the combinations: a bent finger is over 5 pixels shorter.
    new = [min(float((shape - seen).abs().max()) for seen in photographs) > 5 for shape in shapes]
    assert 2 <= sum(new) < 12
    stretched = straight_fingers(np.stack([shape.numpy() for shape in shapes]))
    assert {tuple(row[[1, 4]].tolist()) for row in stretched} == set(
        itertools.product((False, True), repeat=2)
    )


def test_settings_that_cannot_be_are_refused(tmp_path: Path) -> None:
    labels = folder_of(tmp_path, 12)
    with pytest.raises(ValueError, match=r"reading\.cache_dir"):
        LandmarkDataModule(labels, exchanged=3)
    with pytest.raises(ValueError, match="exchanged=-1"):
        data(tmp_path, exchanged=-1)
