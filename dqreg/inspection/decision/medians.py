"""Medians of neighbouring points: what a surface does, without what single points do."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.inspection.decision.places import MEDIAN_SIGMA, PLACE_POINTS
from dqreg.solvers.robust import GAUSSIAN_MEDIAN


def smoothed(values: FloatArray, points: FloatArray, labels: IntArray | None = None) -> tuple[FloatArray, float]:
    """Median of each point's neighbourhood, and the standard deviation of such a median. Shapes: (n,), (n, 3), (n,).

    Neighbours have the same label; a label of fewer than 50 points has medians of half of them. Fewer than 50 points
    in all are probed by hand: each is meant, and the deviation of one is not known.
    """
    from scipy.spatial import cKDTree

    medians, spreads = values.copy(), np.zeros(len(values))
    names = np.zeros(len(values), dtype=np.int64) if labels is None else labels
    order = np.argsort(names, kind="stable")
    for rows in np.split(order, 1 + np.flatnonzero(np.diff(names[order]))):
        count = min(PLACE_POINTS, len(rows) // 2)
        if len(values) >= 2 * PLACE_POINTS and count > 1:
            around = values[rows][cKDTree(points[rows]).query(points[rows], k=count)[1]]
            medians[rows] = np.median(around, axis=1)
            spreads[rows] = np.median(np.abs(around - medians[rows, None]), axis=1)
    known = spreads > 0.0
    spread = GAUSSIAN_MEDIAN * float(np.median(spreads[known])) if known.any() else 0.0
    return medians, MEDIAN_SIGMA * spread / math.sqrt(PLACE_POINTS)
