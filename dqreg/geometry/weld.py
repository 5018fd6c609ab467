"""Vertices that stand in one place become one: only then can be told which triangles meet."""

from __future__ import annotations

import numpy as np

from dqreg.arrays import FloatArray, IntArray

# Two corners nearer than this, in extents of the part, are one. CAD programs write 0 and 1e-17 for the same corner
# (so do three of nine real parts tried), while float32, the resolution of STL, tells nothing below 6e-8 apart.
SAME_VERTEX = 1e-9


def merge_identical(vertices: FloatArray) -> tuple[FloatArray, IntArray]:
    """Different vertices only, and where each given one went.

    Vertices are the same if they round to the same node of a grid through the origin with a spacing of `SAME_VERTEX`
    times the largest extent. The first of them in the list keeps its exact place for all.

    Shapes: distinct (d, 3), place (v,).
    """
    with np.errstate(over="ignore"):
        spacing = SAME_VERTEX * float(np.ptp(vertices, axis=0).max())
        # A single point, or an extent beyond float64, has no grid; then only equal numbers are the same.
        nodes = np.round(vertices / spacing) if 0.0 < spacing < np.inf else vertices
    order = np.lexsort(nodes.T)
    ranked = nodes[order]
    opens = np.concatenate([[True], (ranked[1:] != ranked[:-1]).any(axis=1)])
    group = np.zeros(len(vertices), dtype=np.int64)
    group[order] = np.cumsum(opens) - 1
    # lexsort is stable, so the first of a group is its first appearance in the list.
    first = order[opens]
    by_appearance = np.argsort(first)
    rank = np.argsort(by_appearance)
    return vertices[first[by_appearance]], rank[group].astype(np.int64)
