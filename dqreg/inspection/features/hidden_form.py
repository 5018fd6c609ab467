"""What lobes do to a round shape that was seen on a part of a turn: a fit takes some of them for size and place."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection.features.models import FeatureKind, Shape, distances
from dqreg.solvers.robust import GAUSSIAN_MEDIAN

# Lobes that are tried; one turn of them is a shift.
LOBES = range(2, 10)
# Points farther than that many robust standard deviations are left out; fewer points tell no lobes.
OUTLIER_SIGMAS, MIN_POINTS = 5.0, 50


def hidden_form(kind: FeatureKind, shape: Shape, points: FloatArray) -> FloatArray:
    """Covariance of the parameters that lobes give them, (k, k), added to that of noise.

    The fit is repeated with each number of lobes beside the parameters; what these change by counts as often as the
    residuals ask for those lobes (Bayesian information criterion; Schwarz 1978). Of a whole turn nothing changes.
    """
    rows, slopes = distances(kind, shape, points)
    none = np.zeros((slopes.shape[1],) * 2)
    if kind not in ("cylinder", "cone") or len(points) < MIN_POINTS:
        return none
    local = shape.local(points)
    kept = np.abs(rows) <= OUTLIER_SIGMAS * GAUSSIAN_MEDIAN * float(np.median(np.abs(rows)))
    rows, slopes, turn = rows[kept], slopes[kept], np.arctan2(local[kept, 1], local[kept, 0])
    count, scale = len(rows), np.linalg.norm(slopes, axis=0)
    scores, changes = [0.0], [np.zeros(len(scale))]
    least = float(rows @ rows)
    if count < MIN_POINTS or least == 0.0 or not scale.all():
        return none
    for lobes in LOBES:
        both = np.column_stack([slopes / scale, np.cos(lobes * turn), np.sin(lobes * turn)])
        found = np.linalg.lstsq(both, rows, rcond=None)[0]
        left = rows - both @ found
        scores.append(count * np.log(max(float(left @ left) / least, np.finfo(float).tiny)) + 2.0 * np.log(count))
        changes.append(found[: len(scale)] / scale)
    weights = np.exp(-0.5 * (np.array(scores) - min(scores)))
    steps = np.array(changes)
    return np.asarray((steps.T * (weights / weights.sum())) @ steps)
