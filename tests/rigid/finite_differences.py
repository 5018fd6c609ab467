"""Central differences, the oracle of every Jacobian here."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

STEP = 1e-5
# A function of degree two has no truncation error in central differences, so rounding / STEP is what is left.
ROUNDING = 1e-9


def jacobian(function: Callable[[FloatArray], FloatArray], at: FloatArray, step: float = STEP) -> FloatArray:
    columns = [(function(at + step * e) - function(at - step * e)) / (2 * step) for e in np.eye(at.size)]
    return np.stack(columns, axis=-1)
