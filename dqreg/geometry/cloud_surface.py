"""A cloud as a surface: the nearest point, from a KD-tree in float64, with the normal fitted there."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from dqreg._arrays import MAX_LENGTH, BoolArray, FloatArray, IntArray, dot, require_finite, require_workable
from dqreg._records import remember
from dqreg.errors import InputError
from dqreg.geometry.boundary import CloudBoundary
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.distinct_points import DistinctPoints
from dqreg.geometry.morton import distinct_in_order
from dqreg.geometry.neighbours import (
    CHUNK_QUERIES,
    Before,
    Candidates,
    KdTree,
    NeighbourTree,
    distinct_rows,
    followed,
    found_in_tree,
)
from dqreg.geometry.normals import PlaneFits, fit_planes_around, orient_towards
from dqreg.geometry.surface import Closest, Hint, as_queries

# Nearest points of a query that are kept of derived clouds: with two the tree is asked again for a third of the queries
# at each step.
DERIVED_CANDIDATES = 4
# Open3D's takes half as long again for four, which is more than that saves; of so many points, in whose tree a query
# comes from far away in memory, less: a tenth of a depth image's time.
OPEN3D_CANDIDATES, MANY_POINTS = 2, 100_000


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

    Raises
    ------
    InputError
        If ``fitted`` is not one row for each distinct point.

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
            remember(self, _tree=NeighbourTree(self._points, late=True))
        self._search: KdTree | NeighbourTree = self._tree if derived else KdTree(self._points)
        self._kept = DERIVED_CANDIDATES if derived or size > MANY_POINTS else OPEN3D_CANDIDATES
        low, high = cloud._ends
        self.centre: FloatArray = 0.5 * (low + high)
        self.diagonal = float(np.linalg.norm(high - low))
        self._viewpoint = cloud.viewpoint
        self.oriented = cloud.normals is not None or cloud.viewpoint is not None

    @property
    def _distinct(self) -> DistinctPoints:
        """Its distinct points: made at each call, as it would hold the surface that holds it."""
        return DistinctPoints(self._points, self._rows, self._planes_at, lambda: self._tree)

    @property
    def _means(self) -> FloatArray:
        """What the points are before noise was taken from them, (m, 3): they themselves, but of a cloud's cells."""
        return self._points

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
        self._fit_at(rows)
        return np.take(self._normals, rows, axis=0), self._variances[rows]

    def _fit_at(self, rows: IntArray) -> None:
        # Fitted on demand: a registration touches a part of a large cloud. The fit at a point depends on
        # the cloud alone, so threads that meet here write the same; a normal is there before it is called known.
        missing = rows[~self._known[rows]]
        if len(missing):
            missing = distinct_rows(missing, len(self._known))
            self._enter(missing, self._fitted_around(missing))

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

        A query that moved by m since the hint has no point but its candidates nearer than ``others - m``; while one of
        these is nearer than that, it is the match, and the KD-tree is not asked.

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

        Raises
        ------
        InputError
            If the queries are no (n, 3) finite real numbers.
        """
        points = as_queries(points)
        before = None if hint is None else _known_before(*hint)
        if before is None:
            _require_near(points)
        if isinstance(self._search, NeighbourTree):
            # What stands at the matches is looked up at once where it is known of all points.
            held = (self._points, self._normals, self._variances, self.order) if self._all_fitted else None
            found = found_in_tree(self._search, points, before, self._kept, self._points, held)
            return found if isinstance(found, Closest) else self._answer(*found)
        if before is not None:
            return self._closest_near(points, *before)
        rows, distances = self._search.nearest(points, self._kept)
        return self._answer(rows[:, 0], distances[:, 0], self._beyond(distances), rows.astype(np.int32))

    def _closest_near(
        self, points: FloatArray, places: FloatArray, candidates: Candidates, others: FloatArray
    ) -> Closest:
        rows, distances, others = followed(points, places, candidates, others, self._points)
        asked = np.flatnonzero(distances >= others)
        if len(asked):
            found, away = self._search.nearest(np.take(points, asked, axis=0), self._kept)
            candidates = candidates.copy()
            candidates[asked], rows[asked] = found, found[:, 0]
            distances[asked], others[asked] = away[:, 0], self._beyond(away)
        return self._answer(rows, distances, others, candidates)

    def _distances(self, points: FloatArray) -> FloatArray:
        """Distances of queries alone, (n,): in half the time, and no normal is fitted for them."""
        return self._tree.nearest(points, 1)[1][:, 0]

    def _beyond(self, distances: FloatArray) -> FloatArray:
        """What no point but so many nearest ones, (n, k) distances, is nearer than, (n,)."""
        is_all = distances.shape[1] == len(self._points)
        return np.full(len(distances), np.inf) if is_all else distances[:, -1].copy()

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

        Examples
        --------
        >>> grid = np.mgrid[0:9.0, 0:9.0, 0:1].reshape(3, -1).T
        >>> surface = CloudSurface(PointCloud(grid))
        >>> surface.on_rim(surface.closest(np.array([[4.0, 4, 1], [8, 8, 1]]))).tolist()
        [False, True]
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

    def _answer(self, rows: IntArray, distances: FloatArray, others: FloatArray, candidates: Candidates) -> Closest:
        from dqreg.kernels.threads import over_chunks
        from dqreg.kernels.trees.follow_rows import look_up_rows

        self._fit_at(rows)
        count = len(rows)
        points, normals = np.zeros((2, count, 3))
        variances, elements = np.zeros(count), np.zeros(count, dtype=np.int64)
        held = self._points, self._normals, self._variances, self.order
        given = np.ascontiguousarray(rows), *held
        over_chunks(look_up_rows, count, *given, points, normals, variances, elements, chunk=CHUNK_QUERIES)
        # Each kernel would make a copy of a column among others.
        found = Closest(points, normals, np.ascontiguousarray(distances), elements, others, variances)
        return found._with(candidates)


def _known_before(places: FloatArray, closest: Closest) -> Before | None:
    """Earlier places of queries, with what is known of their matches there; None where they cannot be followed."""
    known, others = closest._candidates, closest.others
    return None if known is None or others is None else (places, known, others)


def _require_near(queries: FloatArray) -> None:
    """Raise where the tree could not square distances: NaN and what is too large are not below."""
    flat = queries.ravel()
    with np.errstate(over="ignore", invalid="ignore"):
        squares = dot(flat, flat)
    if not squares <= MAX_LENGTH**2:
        require_finite(queries, "points")
        require_workable(queries, "points")
