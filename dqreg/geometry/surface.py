"""Protocol of a target: closest points, the same for a cloud and a mesh."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray, as_vectors
from dqreg._records import remember


@dataclasses.dataclass(frozen=True)
class Closest:
    """The closest place on a surface for each query point.

    Attributes
    ----------
    points : ndarray, (n, 3)
        Closest points, in the surface's frame.
    normals : ndarray, (n, 3)
        Unit normal of the surface there.
    distances : ndarray, (n,)
        Euclidean distance from the query to the closest point, >= 0.
    elements : ndarray of int, (n,)
        Which cloud point or which face it is.
    others : ndarray, (n,), optional
        Lower bound of the distance to all points of a cloud but the closest one, and the candidates where there are
        some; None where it is not known.
    variances : ndarray, (n,), optional
        Variance of each normal, rad^2, see `PlaneFits.variances`; None where the normals are exact.
    """

    points: FloatArray
    normals: FloatArray
    distances: FloatArray
    elements: IntArray
    others: FloatArray | None = None
    variances: FloatArray | None = None
    # (n, k): The nearest points by the surface's own numbers; after a small motion one of them is the closest
    _candidates: NDArray[np.int32] | None = dataclasses.field(default=None, init=False, repr=False)

    def _taken(self, rows: IntArray) -> Closest:
        """Those of some of the queries."""
        others, variances = (None if x is None else x[rows] for x in (self.others, self.variances))
        points, normals = np.take(self.points, rows, axis=0), np.take(self.normals, rows, axis=0)
        some = Closest(points, normals, self.distances[rows], self.elements[rows], others, variances)
        return some if self._candidates is None else some._with(np.take(self._candidates, rows, axis=0))

    def _with(self, candidates: NDArray[np.int32]) -> Closest:
        """Itself, from now on with candidates."""
        return remember(self, _candidates=candidates)


def as_queries(points: FloatArray) -> FloatArray:
    """Queries of `Surface.closest`, (n, 3), NaN or not; what the loop asks passes untouched."""
    if type(points) is np.ndarray and points.dtype == np.float64 and points.ndim == 2 and points.shape[1] == 3:
        return points
    return as_vectors(points, "points", finite=False)


# Where the same queries stood earlier, (n, 3), and what this surface answered there.
Hint = tuple[FloatArray, Closest]


class Surface(Protocol):
    """A target that finds closest points; read-only after it is built, so threads may share it."""

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box, the size S."""
        ...

    @property
    def centre(self) -> FloatArray:
        """Middle of the bounding box, (3,)."""
        ...

    @property
    def oriented(self) -> bool:
        """Whether the normals point outwards for sure (a mesh), or only up to sign (an estimate)."""
        ...

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Closest place for each query.

        Parameters
        ----------
        points : ndarray, (n, 3)
            Queries in the surface's frame; n may be 0.
        hint : (ndarray, Closest), optional
            Where the same queries stood earlier, (n, 3), and what the surface answered there. It may save work after
            small motions, and never changes what is found by more than rounding.
        within : float
            Distance from which on nothing need be found: distances may be infinite there, and points NaN.

        Returns
        -------
        Closest
            One place a query.
        """
        ...
