"""Images that a fit writes."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from hand_recon.fitting.results import write_results
from hand_recon.hand.model import HandModel
from tests.support.fitted_hands import SMALL_RESULTS, fitted


def test_images_show_the_hand_on_its_image_and_a_sheet_shows_all(
    hand: HandModel, tmp_path: Path
) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((480, 640, 3), (0, 0, 255), dtype=np.uint8))
    part = fitted(hand)
    images = (tmp_path / "a.png", None, None)
    part = dataclasses.replace(part, observed=dataclasses.replace(part.observed, images=images))
    write_results(tmp_path / "run", [part], hand.faces, SMALL_RESULTS)
    first, second = sorted((tmp_path / "run" / "pictures").iterdir())
    on_image, on_white = cv2.imread(str(first)), cv2.imread(str(second))
    assert on_image is not None
    assert on_white is not None
    assert on_image.shape == (48, 4 * 48, 3)
    assert on_image[1, 1].tolist() == [0, 0, 255]
    assert on_white[1, 1].tolist() == [255, 255, 255]
    # The mesh covers some of the third panel, on either hand.
    assert (on_white[:, 96:144] != 255).any(axis=-1).mean() > 0.1
    sheet = cv2.imread(str(tmp_path / "run" / "fits.png"))
    assert sheet is not None
    assert sheet.shape[0] > 2 * 48


def test_an_image_that_cannot_be_read_is_named_and_drawn_on_white(
    hand: HandModel, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    part = fitted(hand)
    images = (tmp_path / "gone.png", None, None)
    part = dataclasses.replace(part, observed=dataclasses.replace(part.observed, images=images))
    write_results(tmp_path, [part], hand.faces, SMALL_RESULTS)
    assert "gone.png: hand 0 is drawn on white" in caplog.text
