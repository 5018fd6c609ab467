"""Weights and energy of the correspondences of one iteration."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray, dot
from dqreg.geometry.scan import Scan
from dqreg.icp.correspondences import Correspondences
from dqreg.icp.rejectors import NormalAngle, Robust, Weight, WithinDistance, product
from dqreg.solvers.robust import InlierMixture, Kernel

# Rows that are weighed in one go.
CHUNK_ROWS = 16_384
# No column.
NOTHING = np.zeros(0)


@dataclasses.dataclass(frozen=True)
class Weighed:
    """What the weights of correspondences come to."""

    weights: FloatArray  # (n,)
    energy: float  # Mean robust cost, a length squared
    total: float  # Sum of the weights
    mean_square: float  # Weighted mean squared distance
    used: int  # Rows with a weight above zero


@dataclasses.dataclass(frozen=True)
class MixtureWeights:
    """Weights by a mixture and by the usual two rejectors, beside others: what one compiled pass can do."""

    kernel: InlierMixture
    within: WithinDistance
    angle: NormalAngle
    others: tuple[Weight, ...]

    @staticmethod
    def of(kernel: Kernel, rejectors: Sequence[Weight]) -> MixtureWeights | None:
        """The parts of a loop by their kinds; None where there are others."""
        within = next((r for r in rejectors if type(r) is WithinDistance), None)
        angle = next((r for r in rejectors if type(r) is NormalAngle), None)
        others = tuple(r for r in rejectors if r is not within and r is not angle)
        is_plain = type(kernel) is InlierMixture and not any(type(r) in (WithinDistance, NormalAngle) for r in others)
        if not is_plain or not isinstance(kernel, InlierMixture) or within is None or angle is None:
            return None
        return MixtureWeights(kernel, within, angle, others)

    def factors(self, pairs: Correspondences) -> FloatArray:
        """Factors of the weights by the other rejectors, (n,); (0,) where there are none."""
        return product(self.others, pairs) if self.others else NOTHING

    def limits(self, pairs: Correspondences) -> FloatArray:
        """Limits as `weigh_rows` takes them, (5,)."""
        kernel, angle = self.kernel, math.cos(self.angle.limit_rad)
        return np.array([self.within.limit, angle, float(pairs.same_sign), kernel.scale, kernel.odds])

    def weighed(self, weights: FloatArray, sums: FloatArray) -> Weighed:
        """What weights come to, given the sums of chunks, (k, 5)."""
        represented, energy, total, squares, used = np.add.reduce(sums).tolist()
        mean, scale = energy / represented - math.log1p(self.kernel.odds), self.kernel.scale
        return Weighed(weights, -2.0 * scale**2 * mean, total, squares / total if total > 0.0 else math.nan, int(used))


def weigh(pairs: Correspondences, kernel: Kernel, rejectors: Sequence[Weight]) -> Weighed:
    """Weights by a kernel and by rejectors; in one compiled pass where these are a mixture and the usual two."""
    mixture = MixtureWeights.of(kernel, rejectors)
    if mixture is not None:
        return _in_one_pass(pairs, mixture)
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


def _in_one_pass(pairs: Correspondences, mixture: MixtureWeights) -> Weighed:
    from dqreg.kernels.steps.weighing import SUMS, weigh_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    scan, R = pairs.scan, pairs.T_target_source[:3, :3]
    weights, sums = np.zeros(len(scan)), np.zeros((max(-(-len(scan) // CHUNK_ROWS), 1), SUMS))
    columns = pairs.distances, pairs.closest.normals, scan._rejecting_normals, R, *counted(scan), mixture.factors(pairs)
    given = [as_plain(column) for column in (*columns, mixture.limits(pairs))]
    over_chunks(weigh_rows, len(scan), *given, CHUNK_ROWS, weights, sums, chunk=CHUNK_ROWS)
    return mixture.weighed(weights, sums)


def counted(scan: Scan) -> tuple[FloatArray, FloatArray]:
    """Points that each row of a scan stands for, and their scatter, (n,); (0,) where each row is a point."""
    is_mean = scan.counts is not None and scan.within is not None
    return NOTHING if scan.counts is None else scan.counts, np.asarray(scan.scatter) if is_mean else NOTHING
