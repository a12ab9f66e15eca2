"""σ of a fit's landmarks: given, from the confidence, or neither."""

import math
from dataclasses import replace

import pytest
import torch

from hand_recon.fitting.observation import (
    SIGMA_BOUNDS,
    UNKNOWN_SIGMA,
    confidence_of_sigma,
    observed,
    sigma_of_confidence,
)
from hand_recon.hand.model import HandModel
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views

COUNT = 8


def test_confidence_and_sigma_are_two_words_for_one_thing() -> None:
    sigma = torch.linspace(1.0, 25.0, 21)[None]
    assert_close(sigma_of_confidence(confidence_of_sigma(sigma)), sigma)
    for half_sigma in (2.0, 5.0, 9.0):
        half = sigma_of_confidence(torch.full((1, 21), 0.5), half_sigma)
        assert_close(half, torch.full((1, 21), half_sigma))
    # 1 / (1 + (10 / 5)²) = 0.2
    assert_close(confidence_of_sigma(torch.full((1, 21), 10.0)), torch.full((1, 21), 0.2))


def test_no_confidence_is_taken_at_its_word() -> None:
    confidence = torch.tensor([0.0, 1.0, math.nan]).repeat(7)[None]
    sigma = sigma_of_confidence(confidence)
    assert sigma[0, :2].tolist() == [SIGMA_BOUNDS[1], SIGMA_BOUNDS[0]]
    assert sigma[0, 2].isnan()


def test_told_sigma_goes_before_confidence_and_ignorance_is_three_pixels(hand: HandModel) -> None:
    seen = views(hand, known_hands(hand, COUNT))
    noise = torch.full((COUNT, 21), torch.nan)
    noise[:, 0] = 7.0
    confidence = torch.full((COUNT, 21), 0.5)
    confidence[:, 2] = torch.nan
    known = observed(replace(seen, label_noise=noise, confidence=confidence)).log_sigma().exp()
    assert known.shape == (COUNT, 21, 2)
    assert known[0, :3, 0].tolist() == pytest.approx([7.0, 5.0, UNKNOWN_SIGMA])
    nothing = observed(seen).log_sigma().exp()
    assert_close(nothing, torch.full((COUNT, 21, 2), UNKNOWN_SIGMA))
