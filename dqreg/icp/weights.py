"""Weights of pairs: each is a small callable from `Pairs` to (n,) factors; factors multiply, zero rejects."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.icp.kernels import Kernel
from dqreg.icp.pairs import Pairs

Weight = Callable[[Pairs], FloatArray]


@dataclasses.dataclass(frozen=True)
class WithinDistance:
    """Rejects pairs farther apart than the limit, a length in the target's unit."""

    limit: float

    def __call__(self, pairs: Pairs) -> FloatArray:
        """1 within the limit, else 0."""
        return np.where(pairs.distances <= self.limit, 1.0, 0.0)


@dataclasses.dataclass(frozen=True)
class NormalAngle:
    """Rejects pairs whose normals differ by more than the limit; pairs without a normal on either side pass.

    Where the sign of either normal is unknown, the angle between the lines counts, 0 to 90 degrees.
    """

    limit_rad: float

    def __call__(self, pairs: Pairs) -> FloatArray:
        """1 within the limit or where there is nothing to compare, else 0."""
        rows = np.flatnonzero(pairs.scan.directed)
        factors = np.ones(len(pairs.distances))
        cosines = pairs.normal_cosines[rows] if pairs.same_sign else np.abs(pairs.normal_cosines[rows])
        known = pairs.closest.normals[rows].any(axis=1)
        factors[rows] = np.where((cosines >= np.cos(self.limit_rad)) | ~known, 1.0, 0.0)
        return factors


@dataclasses.dataclass(frozen=True)
class Robust:
    """Weighs pairs by a robust kernel of their distance."""

    kernel: Kernel

    def __call__(self, pairs: Pairs) -> FloatArray:
        """The kernel's weights."""
        return self.kernel.weight(pairs.distances)


@dataclasses.dataclass(frozen=True)
class Trimmed:
    """Keeps the given share of the pairs, the closest ones (Chetverikov et al. 2002)."""

    share: float

    def __call__(self, pairs: Pairs) -> FloatArray:
        """1 for the closest pairs, else 0."""
        keep = int(np.ceil(self.share * len(pairs.distances)))
        weights = np.zeros(len(pairs.distances))
        weights[np.argsort(pairs.distances, kind="stable")[:keep]] = 1.0
        return weights


def product(weights: Sequence[Weight], pairs: Pairs) -> FloatArray:
    """Product of all factors for each pair."""
    total = np.ones(len(pairs.distances))
    for weight in weights:
        total *= weight(pairs)
    return total
