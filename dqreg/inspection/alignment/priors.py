"""A pose of an alignment that is known beforehand, and what it adds to the covariance."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.solvers import PoseCost


def prior_about(prior: Any, centre: FloatArray, origin: FloatArray) -> PoseCost:
    """The cost of a pair (pose, covariance about the centre) between frames that count from an origin."""
    try:
        T, covariance = prior
    except (TypeError, ValueError):
        raise InputError(f"prior must be (pose, covariance), a 4x4 and a 6x6; got {type(prior).__name__}") from None
    return PoseCost.prior(T, covariance, centre + origin).recentred(origin, origin)


def inverse_within(information: FloatArray, basis: FloatArray) -> FloatArray:
    """Covariance of a twist that may take the directions of a basis alone. Shapes: (6, 6), (6, k)."""
    if not basis.shape[1]:
        return np.zeros((6, 6))
    found: FloatArray = basis @ np.linalg.inv(basis.T @ information @ basis) @ basis.T
    return 0.5 * (found + found.T)
