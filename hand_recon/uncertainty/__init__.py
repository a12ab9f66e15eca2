"""The data term: how far the projected landmarks may lie from their labels (Sec. 3.3, Eq. 6-7).

`likelihoods` has the equations, `bounds` keeps σ in a range that means something, `data_term` makes
one value per hand of them, `staged` is the paper's schedule: squared error first, then the
likelihood (Sec. 4.1).
"""

from hand_recon.uncertainty.bounds import soft_bound
from hand_recon.uncertainty.data_term import (
    DataTerm,
    FullCovariance,
    LaplaceLikelihood,
    NegativeLogLikelihood,
    RescaledSquaredError,
    SquaredError,
)
from hand_recon.uncertainty.staged import Staged

__all__ = [
    "DataTerm",
    "FullCovariance",
    "LaplaceLikelihood",
    "NegativeLogLikelihood",
    "RescaledSquaredError",
    "SquaredError",
    "Staged",
    "soft_bound",
]
