"""The surface as a grid knows it: the tangent plane at the place closest to the nearest node, looked up, not searched.

While a pose is still a hundredth of the size off, that is as good as the closest place itself, for a hundredth of the
time.
"""

from __future__ import annotations

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.geometry import Surface
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.surface import Closest
from dqreg.start.screening import DistanceGrid

# Nodes closer to the surface than this, in sizes, ask it; of the others a dense sample knows enough.
ASKED = 0.025


class PlaneGrid(DistanceGrid):
    """Distances and tangent planes on a regular grid."""

    def __init__(
        self, surface: Surface, places: FloatArray, normals: FloatArray, low: FloatArray, high: FloatArray
    ) -> None:
        self.diagonal, self.centre, self.oriented = surface.diagonal, surface.centre, surface.oriented
        tree = NeighbourTree(places)
        planes = np.zeros((0, 6), dtype=np.float32)

        def distances(nodes: FloatArray) -> FloatArray:
            nonlocal planes
            rows, found = tree.nearest(nodes, 1)
            # What lies outside is on no plane: the last row.
            planes = np.zeros((len(nodes) + 1, 6), dtype=np.float32)
            planes[:-1, :3], planes[:-1, 3:] = places[rows[:, 0]], normals[rows[:, 0]]
            distances = found[:, 0]
            near = np.flatnonzero(distances < ASKED * surface.diagonal)
            asked = surface.closest(nodes[near])
            planes[near, :3], planes[near, 3:], distances[near] = asked.points, asked.normals, asked.distances
            return distances

        super().__init__(distances, low, high, surface.diagonal)
        self._planes = planes

    def closest(self, points: FloatArray) -> Closest:
        """Foot on the tangent plane, its normal, and the distance; infinite outside the grid, (n, 3) each."""
        nodes = self.nodes(points)
        planes = self._planes[nodes].astype(np.float64)
        gap, normals = points - planes[:, :3], planes[:, 3:]
        height = np.einsum("ij,ij->i", gap, normals)
        # The place is the node's: as far as the node may be aside, so far the place may be.
        aside = np.sqrt(np.maximum(np.einsum("ij,ij->i", gap, gap) - height**2, 0.0)) - self.cell
        distances = np.hypot(height, np.maximum(aside, 0.0))
        distances[nodes == len(self.distances)] = np.inf
        return Closest(points - height[:, None] * normals, normals, distances, nodes)
