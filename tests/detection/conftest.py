"""Photographs and models for the tests of the detector."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from jaxtyping import UInt8

from tests.support.detector_models import published_models

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="session")
def models() -> Path:
    """Folder of the published models."""
    return published_models()


@pytest.fixture(scope="session")
def two_hands() -> UInt8[np.ndarray, "height width 3"]:
    """Photograph of two left hands: the backs, one with the fingers up, one with the fingers down."""
    return read(EXAMPLES / "two_hands.jpg")


@pytest.fixture(scope="session")
def one_hand() -> UInt8[np.ndarray, "height width 3"]:
    """Photograph of a right hand that shows thumb, index and middle finger, the palm to the camera."""
    return read(EXAMPLES / "hand.jpg")


def read(path: Path) -> UInt8[np.ndarray, "height width 3"]:
    image = cv2.imread(str(path))
    assert image is not None
    return np.ascontiguousarray(image[..., ::-1], dtype=np.uint8)
