"""Whether the normals that came with a cloud have a side: near neighbours on a smooth face point the same way."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.morton import distinct_in_order, in_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.scan_measures import MIDDLE_POINTS, PIECE_COUNT, PIECE_POINTS, THINNED_POINTS

# Points that are asked, and neighbours of each.
ASKED_POINTS, ASKED_NEIGHBOURS = 2_000, 8
# Two points are on one smooth face where their planes agree up to sign, and neither stands off the other's by more than
# this share of their distance.
SAME_FACE_COS, MAX_OFF_SHARE = 0.9, 0.25
# Pairs that point to opposite ways, of all on one face, from which normals have no side. Oriented ones came to 0.007 at
# most, signs at random to 0.5, and those of a plane fit, which stay the same over patches, to 0.013 and more but for
# one of 60 clouds, where 3 of 10,000 were wrong.
MAX_OPPOSITE_SHARE = 0.01
# Pairs without which nothing is told: signs at random, of the 25 points that have so many, pass once in 10^6.
MIN_PAIRS = 200


def have_sides(points: FloatArray, normals: FloatArray) -> bool:
    """Whether normals point the same way on each smooth face, (n, 3) both; so it is where too few points tell.

    Both sides of a thin sheet point to opposite ways too, but there each point stands behind the other. Without sides
    as many stand before it: so what counts is twice the fewer of both.
    """
    order = distinct_in_order(points)
    points, normals = in_order(points, order), in_order(normals, order)
    rows, others = _neighbours(points)
    apart, one, other = points[others] - points[rows][:, None], normals[rows][:, None], normals[others]
    lengths, cosines = np.linalg.norm(apart, axis=2), (one * other).sum(axis=2)
    heights = (apart * one).sum(axis=2), -(apart * other).sum(axis=2)
    on_one_face = (np.abs(cosines) > SAME_FACE_COS) & (np.abs(heights).max(axis=0) < MAX_OFF_SHARE * lengths)
    behind = np.sign(sum(heights))[on_one_face & (cosines < 0.0)]
    opposite = 2 * min(np.count_nonzero(behind < 0.0), np.count_nonzero(behind > 0.0))
    total = np.count_nonzero(on_one_face)
    # On exact planes neither is behind.
    opposite += np.count_nonzero(behind == 0.0)
    return bool(total < MIN_PAIRS or opposite < MAX_OPPOSITE_SHARE * total)


def without_signs(cloud: PointCloud) -> PointCloud:
    """The cloud without its normals where these have no side: they say no more than planes fitted to its points."""
    if cloud.normals is None or have_sides(cloud.points, cloud.normals):
        return cloud
    return cloud._changed(normals=None)


def _neighbours(points: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows of some of the points, (m,), in Morton order, and of their neighbours, (m, k)."""
    if len(points) <= THINNED_POINTS:
        rows = sample_rows(len(points), ASKED_POINTS)
        return rows, NeighbourTree(points, in_order=True).nearest(points[rows], ASKED_NEIGHBOURS + 1)[0][:, 1:]
    # Runs along the curve are patches of the surface with all of their points.
    firsts = np.linspace(0, len(points) - PIECE_POINTS, PIECE_COUNT).astype(np.int64)[:, None]
    kept, rows = (
        (firsts + part).ravel()
        for part in (np.arange(PIECE_POINTS), (PIECE_POINTS - MIDDLE_POINTS) // 2 + np.arange(MIDDLE_POINTS))
    )
    found = NeighbourTree(points[kept], in_order=True).nearest(points[rows], ASKED_NEIGHBOURS + 1)[0]
    return rows, kept[found[:, 1:]]
