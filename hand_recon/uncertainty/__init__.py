"""Data terms: losses on the residuals of the projected landmarks (Sec. 3.3, Eq. 6-7).

`likelihoods` has the equations, `bounds` keeps σ in a meaningful range, `data_term` reduces both to one value
per hand, and `staged` is the paper's schedule: squared error first, then the likelihood (Sec. 4.1).
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
