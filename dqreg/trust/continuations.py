"""Faces of a scan that go on beyond the target beside the points that lie on it, however few these are.

A part amid a scene ends where its faces end: beside a point on it the next ones are on it as well, or on something that
stands in another plane. A pose that rests on a corner of something larger has its points in planes that go on. Segments
tell so too, but only of dozens of points a face; here each point answers for itself, by the target's own plane.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.neighbours import NeighbourTree

# Neighbours that are looked at, and those in the plane beyond the target from which on its face goes on.
NEIGHBOURS, GOING_ON = 8, 2
# A neighbour is off the target beyond so many widths, and in the plane of a point within this slope.
OFF_WIDTHS, SLOPE = 2.0, 0.2
# Nothing farther off than this share of the target's size is beside it.
BESIDE = 0.5
# Fewer points on the target say nothing.
FEWEST = 12


def share_going_on(points: FloatArray, normals: FloatArray, distances: FloatArray, width: float, size: float) -> float:
    """Share of placed points on a target, of a size, beside which the scan goes on in its plane; NaN for few.

    Given the normal of the target and its distance at each; within the width points are on it.

    Shapes: points (n, 3), normals (n, 3), distances (n,).
    """
    beside = np.flatnonzero(distances <= max(BESIDE * size, width))
    points, normals, distances = (np.take(x, beside, axis=0) for x in (points, normals, distances))
    on = np.flatnonzero(distances <= width)
    if len(on) < FEWEST:
        return np.nan
    found, apart = NeighbourTree(points).nearest(points[on], min(NEIGHBOURS + 1, len(points)))
    # Where many points are at one place, a point is not its own first neighbour.
    towards = points[found] - points[on][:, None]
    heights = np.abs(np.einsum("ijk,ik->ij", towards, normals[on]))
    in_plane = heights <= np.minimum(width, SLOPE * apart)
    going_on = np.count_nonzero(in_plane & (distances[found] > OFF_WIDTHS * width), axis=1)
    return float(np.mean(going_on >= GOING_ON))
