"""Points with directions, the material of the search: on faces their normals, at edges what leads off the face."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray


@dataclasses.dataclass(frozen=True)
class OrientedPoints:
    """Points with directions of either sign."""

    # points, directions: (n, 3): Unit normals on faces, unit directions off the face at edges; zero where unknown
    points: FloatArray
    directions: FloatArray
    is_edge: BoolArray  # (n,): Whether a point lies at an edge, else on a face
    weights: FloatArray  # (n,): How often each shall be drawn, relative; 0 where there is no direction

    @staticmethod
    def on_faces(points: FloatArray, normals: FloatArray | None = None) -> OrientedPoints:
        """Points on faces alone; without normals these are unknown."""
        directions = np.zeros_like(points) if normals is None else normals
        return OrientedPoints(points, directions, np.zeros(len(points), dtype=bool), np.ones(len(points)))

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: IntArray) -> OrientedPoints:
        return OrientedPoints(self.points[rows], self.directions[rows], self.is_edge[rows], self.weights[rows])

    @property
    def faces(self) -> OrientedPoints:
        """Those on faces."""
        return self[np.flatnonzero(~self.is_edge)] if self.is_edge.any() else self

    @property
    def edges(self) -> OrientedPoints:
        """Those at edges."""
        return self[np.flatnonzero(self.is_edge)]

    def draw(self, count: int, rng: np.random.Generator) -> IntArray:
        """Rows drawn by weight, with replacement."""
        from dqreg.kernels.search.weighted_draws import drawn_rows
        from dqreg.kernels.threads import as_plain

        total = np.cumsum(self.weights)
        if not len(total) or total[-1] <= 0.0:
            return np.zeros(0, dtype=np.int64)
        rows, numbers = np.zeros(count, dtype=np.int64), rng.random(count) * total[-1]
        drawn_rows(as_plain(total), numbers, np.zeros(len(total), dtype=np.int64), rows)
        return rows

    def sample(self, count: int, rng: np.random.Generator) -> OrientedPoints:
        """On faces half evenly drawn and half with rare directions first, and a third as many at edges as well.

        In the order of these points: a tree answers sooner where neighbours follow each other.
        """
        face, edge = np.flatnonzero(~self.is_edge), np.flatnonzero(self.is_edge)
        even = rng.choice(face, size=min(len(face), count // 2), replace=False)
        rare = face[self.faces.draw(count - len(even), rng)]
        edges = rng.choice(edge, size=min(len(edge), count // 3), replace=False)
        return self[np.sort(np.concatenate([even, rare, edges]))]
