"""A cloud as a surface: the nearest point, from a KD-tree in float64, with the normal fitted there."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.geometry.boundary import CloudBoundary
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.morton import distinct_in_order
from dqreg.geometry.neighbours import KdTree, NeighbourTree
from dqreg.geometry.normals import PlaneFits, fit_planes_around, orient_towards
from dqreg.geometry.surface import Closest, Hint

# Two distances that differ by less may be equal: then the tree decides.
ROUNDING = 1e-12
# Queries that are followed in one go.
CHUNK = 16_384


class CloudSurface:
    """A cloud of points as a surface.

    Parameters
    ----------
    cloud : PointCloud
        The target; its normals are used where it has some, else they are fitted to 16 neighbours, towards its viewpoint
        where it has one, of unknown sign else.
    fitted : ndarray, (m, 4), optional
        `fitted` of an earlier surface of the same cloud, which saves fitting its normals again.
    derived : bool
        Whether the cloud was derived from another, as its cells or moved to its middle: it is asked by the compiled
        tree that its planes are fitted with, in half the time, and Open3D's is not built.

    Examples
    --------
    >>> surface = CloudSurface(PointCloud([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
    >>> found = surface.closest(np.array([[0.9, 0.1, 2.0]]))
    >>> found.points.tolist(), np.abs(found.normals).tolist()
    ([[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    """

    def __init__(self, cloud: PointCloud, fitted: FloatArray | None = None, *, derived: bool = False) -> None:
        # Morton order keeps the answers to neighbouring queries close in memory; `elements` count in that order.
        self.order = self._ordered(cloud.points)
        self._points = np.take(cloud.points, self.order, axis=0)
        self._rows = len(cloud.points)
        size = len(self._points)
        if fitted is not None and fitted.shape != (size, 4):
            raise InputError(
                f"fitted normals and variances must be one row per distinct point, {(size, 4)}; got {fitted.shape}. "
                "Take them from a surface of the same cloud"
            )
        # Given normals count as exact.
        given = None if cloud.normals is None else np.column_stack([cloud.normals[self.order], np.zeros(size)])
        if given is None and fitted is not None and cloud.viewpoint is not None:
            fitted = np.hstack([orient_towards(fitted[:, :3], self._points, cloud.viewpoint), fitted[:, 3:]])
        given = fitted if given is None else given
        self._normals = np.zeros((size, 3)) if given is None else given[:, :3].copy()
        self._variances = np.zeros(size) if given is None else given[:, 3].copy()
        self._known = np.full(size, given is not None)
        if derived:
            # Two clouds are prepared beside each other, and `cached_property` of Python 3.11 has one lock for all.
            vars(self)["_tree"] = NeighbourTree(self._points)
        self._search: KdTree | NeighbourTree = self._tree if derived else KdTree(self._points)
        low, high = cloud._ends
        self.centre: FloatArray = 0.5 * (low + high)
        self.diagonal = float(np.linalg.norm(high - low))
        self._viewpoint = cloud.viewpoint
        self.given = cloud.normals is not None
        self.oriented = self.given or cloud.viewpoint is not None

    @property
    def normals(self) -> FloatArray:
        """Unit normals of the distinct points in Morton order, (m, 3); zero where there is none."""
        return self.fitted[:, :3]

    @property
    def fitted(self) -> FloatArray:
        """Normals and their variances in rad^2, (m, 4), in that order; no normal has the variance 1."""
        return np.column_stack(self._planes_at(np.arange(len(self._points))))

    @property
    def _all_fitted(self) -> bool:
        """Whether the normals of all points are known by now."""
        return bool(self._known.all())

    def _planes_at(self, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Normals, (m, 3), and their variances, (m,)."""
        # Fitted on demand: a registration touches a part of a large cloud. The fit at a point depends on
        # the cloud alone, so threads that meet here write the same; a normal is there before it is called known.
        missing = rows[~self._known[rows]]
        if len(missing):
            missing = np.flatnonzero(np.bincount(missing, minlength=len(self._known)))
            self._enter(missing, self._fitted_around(missing))
        return np.take(self._normals, rows, axis=0), self._variances[rows]

    def _enter(self, rows: IntArray, fits: PlaneFits) -> None:
        # A point whose neighbours lie on a line has no normal: zero gives no direction and passes no angle test.
        known = np.isfinite(fits.normals[:, 0])
        normals = np.where(known[:, None], fits.normals, 0.0)
        if self._viewpoint is not None:
            normals = orient_towards(normals, self._points[rows], self._viewpoint)
        self._normals[rows] = normals
        self._variances[rows] = np.where(known, np.minimum(fits.variances, 1.0), 1.0)
        self._known[rows] = True

    def _ordered(self, points: FloatArray) -> IntArray:
        return distinct_in_order(points)

    def _fitted_around(self, rows: IntArray) -> PlaneFits:
        """Planes at some of the points."""
        return fit_planes_around(self._tree, self._points, rows)

    def _all_planes(self) -> PlaneFits | None:
        """Planes at all points, where they cost less than a search for the neighbours of each."""
        return None

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Nearest cloud point for each query.

        A query that moved by m since the hint has no other point nearer than ``others - m``; while the old match is
        nearer than that, it is the match still, and the KD-tree is not asked.

        Parameters
        ----------
        points : ndarray, (n, 3)
            Queries in the cloud's frame; n may be 0.
        hint : (ndarray, Closest), optional
            Earlier places of the same queries and the answer there; the matches are the same without it, distances may
            differ by rounding.
        within : float
            Not used: what is farther off is found as well.

        Returns
        -------
        Closest
            Points, normals (zero where none is known), distances and rows of the cloud as it was given.
        """
        known = None if hint is None else self._closest_near(points, *hint)
        if known is not None:
            return known
        indices, distances = self._search.nearest(points, 2)
        others = distances[:, 1] if distances.shape[1] > 1 else np.full(len(points), np.inf)
        return self._answer(indices[:, 0], distances[:, 0], others)

    def _closest_near(self, points: FloatArray, places: FloatArray, before: Closest) -> Closest | None:
        if before.others is None:
            return None
        distances, others = followed(points, places, before.points, before.others)
        rows = self._ranks[before.elements]
        asked = np.flatnonzero(distances >= others)
        indices, found = self._search.nearest(np.take(points, asked, axis=0), 2)
        if found.shape[1] > 1:
            rows[asked], distances[asked], others[asked] = indices[:, 0], found[:, 0], found[:, 1]
        return self._answer(rows, distances, others)

    def on_rim(self, closest: Closest) -> BoolArray:
        """Whether the matches of some queries are boundary points of the cloud.

        Parameters
        ----------
        closest : Closest
            What `closest` answered.

        Returns
        -------
        ndarray of bool, (n,)
            True on the boundary.
        """
        return self._boundary.at(self._ranks[closest.elements], closest.normals)

    @property
    def _in_lines(self) -> bool:
        """Whether the points lie in lines, as the rings of a LiDAR."""
        return self._boundary.in_lines

    @cached_property
    def _tree(self) -> NeighbourTree:
        """Tree of the distinct points in Morton order."""
        return NeighbourTree(self._points)

    @cached_property
    def _boundary(self) -> CloudBoundary:
        return CloudBoundary(self._tree, self._points)

    @cached_property
    def _ranks(self) -> IntArray:
        # Row in Morton order of each row of the cloud as it was given; copies that were left out have none.
        ranks = np.zeros(self._rows, dtype=np.int64)
        ranks[self.order] = np.arange(len(self.order))
        return ranks

    def _answer(self, rows: IntArray, distances: FloatArray, others: FloatArray) -> Closest:
        points = np.take(self._points, rows, axis=0)
        normals, variances = self._planes_at(rows)
        # Each kernel would make a copy of a column among others.
        return Closest(points, normals, np.ascontiguousarray(distances), self.order[rows], others, variances)


def followed(
    points: FloatArray, places: FloatArray, feet: FloatArray, others: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distances of queries from what was nearest to them at other places, and what no other point is nearer than, (n,).

    Shapes: (n, 3) but for what no other was nearer than there, (n,).
    """
    from dqreg.kernels.threads import as_plain, over_chunks
    from dqreg.kernels.weighing import follow_rows

    distances, bounds = np.zeros(len(points)), np.zeros(len(points))
    given = [as_plain(x) for x in (points, places, feet, others)]
    over_chunks(follow_rows, len(points), *given, 1.0 - ROUNDING, distances, bounds, chunk=CHUNK)
    return distances, bounds
