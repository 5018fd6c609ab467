"""Weights and energy of the correspondences of one iteration."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray, dot
from dqreg.icp.correspondences import Correspondences
from dqreg.icp.rejectors import NormalAngle, Robust, Weight, WithinDistance, product
from dqreg.solvers.robust import InlierMixture, Kernel

# Rows that are weighed in one go.
CHUNK_ROWS = 16_384


@dataclasses.dataclass(frozen=True)
class Weighed:
    """What the weights of correspondences come to."""

    weights: FloatArray  # (n,)
    energy: float  # Mean robust cost, a length squared
    total: float  # Sum of the weights
    mean_square: float  # Weighted mean squared distance
    used: int  # Rows with a weight above zero


def weigh(pairs: Correspondences, kernel: Kernel, rejectors: Sequence[Weight]) -> Weighed:
    """Weights by a kernel and by rejectors; in one compiled pass where these are a mixture and the usual two."""
    within, angle, others = None, None, []
    for rejector in rejectors:
        if within is None and type(rejector) is WithinDistance:
            within = rejector
        elif angle is None and type(rejector) is NormalAngle:
            angle = rejector
        else:
            others.append(rejector)
    usual = type(kernel) is InlierMixture and not any(type(r) in (WithinDistance, NormalAngle) for r in others)
    if usual and isinstance(kernel, InlierMixture) and within is not None and angle is not None:
        return _in_one_pass(pairs, kernel, within, angle, others)
    kept = product(rejectors, pairs)
    weights = kept * Robust(kernel)(pairs)
    counts = pairs.scan.counts
    if counts is not None:
        weights *= counts
    # What a rejector discards costs as much as the farthest one that passes could: else losing pairs would pay.
    farthest = float(pairs.distances.max(where=kept > 0.0, initial=0.0))
    cap = min((r.limit for r in rejectors if isinstance(r, WithinDistance)), default=farthest)
    costs = kernel.cost(np.where(kept > 0.0, pairs.distances, cap))
    total = float(weights.sum())
    square = dot(weights, pairs.squares) / total if total > 0.0 else math.nan
    return Weighed(weights, float(np.average(costs, weights=counts)), total, square, int(np.count_nonzero(weights)))


def _in_one_pass(
    pairs: Correspondences,
    kernel: InlierMixture,
    within: WithinDistance,
    angle: NormalAngle,
    others: Sequence[Weight],
) -> Weighed:
    from dqreg.kernels.threads import as_plain, over_chunks
    from dqreg.kernels.weighing import SUMS, weigh_rows

    scan, nothing, odds = pairs.scan, np.zeros(0), kernel.odds
    weights, sums = np.zeros(len(scan)), np.zeros((max(-(-len(scan) // CHUNK_ROWS), 1), SUMS))
    spread = nothing if scan.counts is None or scan.within is None else np.asarray(scan.scatter)
    limits = [within.limit, math.cos(angle.limit_rad), float(pairs.same_sign), kernel.scale, odds]
    columns = pairs.distances, pairs.closest.normals, scan._rejecting_normals, pairs.T_target_source[:3, :3]
    more = nothing if scan.counts is None else scan.counts, spread, product(others, pairs) if others else nothing
    given = [as_plain(column) for column in (*columns, *more)]
    over_chunks(weigh_rows, len(scan), *given, np.array(limits), CHUNK_ROWS, weights, sums, chunk=CHUNK_ROWS)
    represented, energy, total, squares, used = np.add.reduce(sums).tolist()
    mean = energy / represented - math.log1p(odds)
    return Weighed(
        weights, -2.0 * kernel.scale**2 * mean, total, squares / total if total > 0.0 else math.nan, int(used)
    )
