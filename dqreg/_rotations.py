"""The rotation nearest to a matrix: rounded numbers are no rotation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def nearest_rotation(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations nearest to matrices (Frobenius norm), of mirror images too. Shapes: (..., 3, 3) both.

    >>> nearest_rotation(np.diag([1.1, 0.9, -0.1])).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    U, _, Vt = np.linalg.svd(matrices)
    found = U @ Vt
    mirrored = np.linalg.det(found) < 0.0
    if mirrored.any():
        # The direction of which the matrix says least is turned round.
        U[mirrored, :, 2] *= -1.0
        found = U @ Vt
    return np.asarray(found)
