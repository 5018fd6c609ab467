"""Edges of a part's faces, as places along them: how far a point is from another face."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Mesh

# Places along the edges at most.
MOST = 400_000


def edge_places(mesh: Mesh, of_triangle: IntArray, step: float) -> tuple[FloatArray, float]:
    """Places along all sides at which two faces of the part meet or one ends, and their distance. Shapes: (m, 3)."""
    sides = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    across = mesh.face_neighbours
    own = np.repeat(np.arange(len(mesh.faces)), 3)
    other = across.reshape(-1)
    border = (of_triangle[own] != of_triangle[other]) | (own == other)
    ends = mesh.vertices[sides[border]]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    step = max(step, float(lengths.sum()) / MOST)
    counts = np.maximum(np.ceil(lengths / step).astype(np.int64), 1)
    side = np.repeat(np.arange(len(ends)), counts)
    share = (np.arange(len(side)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[side]
    return ends[side, 0] + share[:, None] * (ends[side, 1] - ends[side, 0]), step
