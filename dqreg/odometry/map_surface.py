"""The map as a surface: nearest map point, with the plane of its neighbours fitted when it is first asked for.

A frame meets a few thousand of the map's hundred thousand points, so fitting on demand saves most of the work; and
the fit sees the points of all frames, not one frame's lines.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.cloud_surface import followed
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes_at
from dqreg.geometry.surface import Closest, Hint

NEIGHBOURS = 12


class MapSurface:
    """Points of a map that grows as a surface, for one thread.

    >>> flat = np.stack(np.meshgrid(range(8), range(8), [0.0]), axis=-1).reshape(-1, 3)
    >>> found = MapSurface(flat).closest(np.array([[3.2, 4.1, 2.0]]))
    >>> found.points.tolist(), np.abs(found.normals).tolist()
    ([[3.0, 4.0, 0.0]], [[0.0, 0.0, 1.0]])
    """

    oriented = False

    def __init__(self, points: FloatArray) -> None:
        from dqreg.kernels.growing_tree import GrowingTree

        self._growing, self._count = GrowingTree(), 0
        self._points = self._normals = np.zeros((0, 3))
        self._variances, self._fitted = np.zeros(0), np.zeros(0, dtype=bool)
        self.room(len(points))[: len(points)] = points
        self.grow(len(points))

    def room(self, more: int) -> FloatArray:
        """Points so far, and behind them room for so many, (m, 3)."""
        if self._count + more > len(self._points):
            rows = 2 * (self._count + more)
            self._points = np.vstack([self.points, np.zeros((rows - self._count, 3))])
            self._normals, self._variances, self._fitted = (
                np.zeros((rows, 3)),
                np.zeros(rows),
                np.zeros(rows, dtype=bool),
            )
        return self._points

    def grow(self, count: int) -> None:
        """Take the points that were written behind those so far, up to a count of all."""
        self._growing.grow(self._points, count)
        # Planes know the points that there were.
        self._count, self._fitted[:] = count, False
        self._tree = NeighbourTree.holding(self._growing.tree, self._points, self._growing.standing)
        self.about(np.zeros(3), np.inf)

    def about(self, place: FloatArray, reach: float) -> None:
        """Measure the surface by what a frame can meet of it: what lies within a reach of a place."""
        low, high = self._growing.tree.boxes[1].reshape(2, 3)
        if not self._count:
            low = high = np.zeros(3)
        near = np.maximum(low, place - reach), np.minimum(high, place + reach)
        low, high = near if (near[0] < near[1]).any() and (near[0] <= near[1]).all() else (low, high)
        self.centre: FloatArray = 0.5 * (low + high)
        self.diagonal = float(np.linalg.norm(high - low))

    @property
    def points(self) -> FloatArray:
        """Of the map, (n, 3)."""
        return self._points[: self._count]

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Nearest map point for each query, (n, 3), with the normal there; zero where the neighbours fix none.

        What was nearest is so still where it is nearer than any other can have come since the hint.
        """
        rows, distances, others = self._nearest(points, hint)
        missing = rows[~self._fitted[rows]]
        if len(missing):
            # In the order of the queries: those that lie close together are answered sooner.
            missing = missing[np.sort(np.unique(missing, return_index=True)[1])]
            fits = fit_planes_at(self._tree, self._points, missing, NEIGHBOURS)
            self._normals[missing] = np.where(fits.known[:, None], fits.normals, 0.0)
            self._variances[missing] = fits.variances
            self._fitted[missing] = True
        found, normals = np.take(self._points, rows, axis=0), np.take(self._normals, rows, axis=0)
        return Closest(found, normals, distances, rows, others)

    def _nearest(self, points: FloatArray, hint: Hint | None) -> tuple[IntArray, FloatArray, FloatArray]:
        """Row of the nearest, distance to it, and what no other is nearer than, (n,) each."""
        others_before = None if hint is None else hint[1].others
        if hint is None or others_before is None or self._count < 2:
            indices, apart = self._tree.nearest(points, 2)
            return indices[:, 0], apart[:, 0], apart[:, -1]
        places, before = hint
        rows, (distances, others) = before.elements.copy(), followed(points, places, before.points, others_before)
        again = np.flatnonzero(distances >= others)
        indices, apart = self._tree.nearest_beside(np.take(points, again, axis=0), rows[again], 2)
        rows[again], distances[again], others[again] = indices[:, 0], apart[:, 0], apart[:, -1]
        return rows, distances, others

    def normal_variances(self, rows: IntArray) -> FloatArray:
        """Variance of the normals at map points that `closest` gave as elements, rad^2, (n,); infinite for none."""
        return self._variances[rows]

    def distances(self, points: FloatArray, cap: float = np.inf) -> FloatArray:
        """Distance of each query, (n, 3), to the nearest map point, or the cap where that is less, (n,)."""
        return self._tree.capped_distances(points, cap)
