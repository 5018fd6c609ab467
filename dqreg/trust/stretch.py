"""Whether a scan is of another shape than its target in the simplest way: longer or shorter along some axis.

A scan of few points does not know its own noise, so that distances alone cannot say whether they are too large. That
they follow a pattern can be said all the same.
"""

from __future__ import annotations

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.trust.covariance import plane_rows

# F of six strains that chance reaches once in a million; residuals of good scans reach 3.
CHANCE = 7.0
# A smaller strain is no mistake: parts shrink, and sensors are calibrated to a part in a hundred at worst.
LEAST = 0.02
# Fewer pairs than these for each of the twelve unknowns say nothing about a pattern.
FEWEST = 10 * 12
# Pairs this many median distances from a first fit are left out.
OUTSIDE = 4.5
# Eigenvalues below this share of the largest: a strain that the faces do not show.
UNSEEN = 1e-6


def stretch_of(points: FloatArray, normals: FloatArray, residuals: FloatArray) -> tuple[float, FloatArray]:
    """Strain of the scan against the target, beside the motion that is left: ``r = n . (w x p + v + E p)``."""
    nothing = 0.0, np.zeros(3)
    if len(residuals) < FEWEST:
        return nothing
    middle = points.mean(axis=0)
    p, n = (points - middle).T, normals.T
    lever = float(np.sqrt((p**2).sum(axis=0).mean()))
    if not lever > 0.0:
        return nothing
    strains = np.stack([n[i] * p[j] + (n[j] * p[i] if i != j else 0.0) for i, j in PLACES]) / lever
    rows = np.vstack([plane_rows(points, normals, middle, lever), strains])
    # Strays and what stands beside the part are one-sided, and would be taken for length.
    off = np.abs(residuals - _least_squares(rows, residuals) @ rows)
    kept = off <= OUTSIDE * float(np.median(off))
    rows, residuals = rows[:, kept], residuals[kept]
    moved, both = (_least_squares(rows[:k], residuals) for k in (6, 12))
    left = [float(np.sum((residuals - x @ rows[: len(x)]) ** 2)) for x in (moved, both)]
    if not left[0] - left[1] > CHANCE * 6.0 * left[1] / (len(residuals) - 12.0):
        return nothing
    E = np.zeros((3, 3))
    for value, (i, j) in zip(both[6:] / lever, PLACES, strict=True):
        E[i, j] = E[j, i] = value
    values, axes = np.linalg.eigh(E)
    k = int(np.abs(values).argmax())
    along = axes[:, k] * np.sign(axes[np.abs(axes[:, k]).argmax(), k])
    return (float(values[k]), along) if abs(values[k]) >= LEAST else nothing


PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _least_squares(rows: FloatArray, residuals: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(rows @ rows.T)
    seen = values > UNSEEN * values[-1]
    inner = vectors[:, seen]
    solution: FloatArray = inner @ ((inner.T @ (rows @ residuals)) / values[seen])
    return solution
