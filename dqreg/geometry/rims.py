"""Where a cloud ends: points whose neighbours all lie to one side."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from dqreg.arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows

# Mean of the neighbours that the tree remembers off the point, in the distance of the farthest: 0.42 where they fill a
# half disc, and above the limit for one point in thirteen of those that fill a disc by chance.
ONE_SIDED = 0.25
# Neighbours that lie along a line, as on the rings of a LiDAR, tell no side: share of the larger variance that the
# smaller has, 0.28 in a half disc.
LINE = 0.15
# A cloud of which more than this share lies in lines was swept, and has ends everywhere; points that tell.
LINED, SAMPLE = 0.2, 500


class Rims:
    """Rim points of a cloud, found where they are first asked for."""

    def __init__(self, tree: NeighbourTree, points: FloatArray) -> None:
        self._tree, self._points = tree, points
        self._rim = np.zeros(len(points), dtype=bool)
        self._known = np.zeros(len(points), dtype=bool)

    def at(self, rows: IntArray, normals: FloatArray) -> BoolArray:
        """Whether points lie on the rim of the cloud."""
        if self._in_lines:
            return np.zeros(len(rows), dtype=bool)
        missing = np.flatnonzero(~self._known[rows])
        if len(missing):
            asked, first = np.unique(rows[missing], return_index=True)
            # What is found depends on the cloud alone, so threads that meet here write the same.
            self._rim[asked] = self._one_sided(asked, normals[missing[first]])
            self._known[asked] = True
        return self._rim[rows]

    def _one_sided(self, rows: IntArray, normals: FloatArray) -> BoolArray:
        spread, distances = self._around(rows)
        # By the mean first: the shape is looked at where it matters.
        middle = spread.mean(axis=1)
        offsets = middle - np.einsum("ij,ij->i", middle, normals)[:, None] * normals
        far = np.flatnonzero(np.linalg.norm(offsets, axis=1) > ONE_SIDED * distances)
        found = np.zeros(len(rows), dtype=bool)
        found[far[~_linear(spread[far])]] = True
        return found

    @cached_property
    def _in_lines(self) -> bool:
        spread, _ = self._around(sample_rows(len(self._points), SAMPLE))
        return float(_linear(spread).mean()) > LINED

    def _around(self, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        # Neighbours about their point, and the distance of the farthest.
        indices, farthest = self._tree.around(rows)
        return np.take(self._points, indices[:, 1:], axis=0) - self._points[rows][:, None], farthest


def _linear(spread: FloatArray) -> BoolArray:
    centred = spread - spread.mean(axis=1, keepdims=True)
    values = np.linalg.eigvalsh(np.matmul(centred.transpose(0, 2, 1), centred))
    return np.asarray(values[:, 1] <= LINE * values[:, 2])
