"""The map as a surface: nearest map point, with the plane of its neighbours fitted when it is first asked for.

A frame meets a few thousand of the map's hundred thousand points, so fitting on demand saves most of the work; and
the fit sees the points of all frames, not one frame's lines.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg.geometry.cloud_surface import ROUNDING
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes
from dqreg.geometry.surface import Closest, Hint

NEIGHBOURS = 12


class MapSurface:
    """Points of a map as a surface, for one thread.

    >>> flat = np.stack(np.meshgrid(range(8), range(8), [0.0]), axis=-1).reshape(-1, 3)
    >>> found = MapSurface(flat).closest(np.array([[3.2, 4.1, 2.0]]))
    >>> found.points.tolist(), np.abs(found.normals).tolist()
    ([[3.0, 4.0, 0.0]], [[0.0, 0.0, 1.0]])
    """

    oriented = False

    def __init__(self, points: FloatArray) -> None:
        # In the order of a tree: what is asked for one after the other lies close together then, and is soon found.
        self._points, self._tree = NeighbourTree(points).renumbered()
        self._normals = np.zeros_like(points)
        self._variances = np.zeros(len(points))
        self._fitted = np.zeros(len(points), dtype=bool)
        low, high = bounds(points)
        self.centre: FloatArray = 0.5 * (low + high)
        self.diagonal = float(np.linalg.norm(high - low))

    @property
    def points(self) -> FloatArray:
        """Of the map, (n, 3)."""
        return self._points

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Nearest map point for each query, (n, 3), with the normal there; zero where the neighbours fix none.

        What was nearest is so still where it is nearer than any other can have come since the hint.
        """
        rows, distances, others = self._nearest(points, hint)
        missing = rows[~self._fitted[rows]]
        if len(missing):
            missing = np.unique(missing)
            fits = fit_planes(self._tree, self._points, np.take(self._points, missing, axis=0), NEIGHBOURS)
            self._normals[missing] = np.where(fits.known[:, None], fits.normals, 0.0)
            self._variances[missing] = fits.variances
            self._fitted[missing] = True
        found, normals = np.take(self._points, rows, axis=0), np.take(self._normals, rows, axis=0)
        return Closest(found, normals, distances, rows, others)

    def _nearest(self, points: FloatArray, hint: Hint | None) -> tuple[IntArray, FloatArray, FloatArray]:
        """Row of the nearest, distance to it, and what no other is nearer than, (n,) each."""
        others_before = None if hint is None else hint[1].others
        if hint is None or others_before is None or len(self._points) < 2:
            return self._asked(points)
        places, before = hint
        rows, distances = before.elements.copy(), _apart(points, before.points)
        others = (others_before - _apart(points, places)) * (1.0 - ROUNDING)
        again = np.flatnonzero(distances >= others)
        rows[again], distances[again], others[again] = self._asked(np.take(points, again, axis=0))
        return rows, distances, others

    def _asked(self, points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        indices, distances = self._tree.nearest(points, 2)
        return indices[:, 0], distances[:, 0], distances[:, -1]

    def normal_variances(self, rows: IntArray) -> FloatArray:
        """Variance of the normals at map points that `closest` gave as elements, rad^2, (n,); infinite for none."""
        return self._variances[rows]

    def distances(self, points: FloatArray, cap: float = np.inf) -> FloatArray:
        """Distance of each query, (n, 3), to the nearest map point, or the cap where that is less, (n,)."""
        return self._tree.capped_distances(points, cap)


def surface_within(points: FloatArray, centre: FloatArray, reach: float) -> MapSurface:
    """The part of a map around a place, as a surface; all of it where nothing is near."""
    away = points - centre
    near = np.einsum("ij,ij->i", away, away) <= reach**2
    return MapSurface(points if near.all() or not near.any() else points[near])


def _apart(points: FloatArray, others: FloatArray) -> FloatArray:
    # As the tree adds the squares, so that a match that is kept has the bits of one that is found.
    x, y, z = (points - others).T
    apart: FloatArray = np.sqrt(x * x + y * y + z * z)
    return apart
