"""The points of a cloud each once, with their tree and their planes: what is asked of a cloud beside closest points."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.spacing import measure_spacing


@dataclasses.dataclass(frozen=True)
class DistinctPoints:
    """The distinct points of a cloud, in Morton order."""

    points: FloatArray  # (m, 3)
    given: int  # Rows of the cloud, copies among them
    # Normals, (k, 3), of some rows and their variances, (k,), fitted where they are not known yet
    planes_at: Callable[[IntArray], tuple[FloatArray, FloatArray]]
    _tree: Callable[[], NeighbourTree]

    def __len__(self) -> int:
        return len(self.points)

    @property
    def tree(self) -> NeighbourTree:
        """Tree of the points, built when it is first asked for."""
        return self._tree()

    @property
    def spacing(self) -> float:
        """Distance of neighbouring points."""
        return measure_spacing(self.tree, self.points)

    def sampled(self, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """So many of the points, (k, 3), evenly taken, their normals, (k, 3), and the variances of these, (k,)."""
        rows = sample_rows(len(self), count)
        return np.take(self.points, rows, axis=0), *self.planes_at(rows)
