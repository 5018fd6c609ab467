"""Dents of faces that a scan shows at a glancing angle: their points are far apart, and beside each other all the same.

Cells are as wide as the usual spacing of the scan asks for. On a face with a tenth of the usual density each point has
a cell for itself, and where such a face is dented, its points look like single ones off every surface.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.inspection.membership.scan_scene import Nominal

# Of so many neighbours on the same side of the part, so many at least lie beside a point of a group: their deviations
# differ by no more than this slope, and so many sigmas of the noise, ask for.
GROUP_NEIGHBOURS, MIN_ALIKE_NEIGHBOURS = 8, 6
ALIKE_SLOPE, ALIKE_SIGMAS = 0.25, 6.0
# Points of a group at least: it goes over into the part as it was scanned at the root of their number.
MIN_GROUP_POINTS = 10
# Feet of neighbours spread over the part: those of a table lie along its edges. Less in one direction by this share.
MAX_LINE_RATIO = 0.05
# Feet with normals that are opposed are that many usual distances of neighbours apart.
OPPOSED_SPACINGS = 10.0
# Points on the part are looked for within so many of those distances.
PART_REACH_SPACINGS = 2.0


def sparse_groups(asked: IntArray, on: BoolArray, values: FloatArray, nominal: Nominal, *, noise: float) -> IntArray:
    """Rows of those asked, of points off the part for themselves, that are of a group that goes over into the part.

    ``on``, (n,): points on the part; ``values``, (n,): the deviations of all.
    """
    if len(asked) < MIN_GROUP_POINTS:
        return asked[:0]
    feet = nominal.feet[asked]
    # Of a group, neighbours are as far apart as its own points are, wherever the others lie.
    weight = 0.5 * OPPOSED_SPACINGS * float(np.median(_neighbours(feet, feet, GROUP_NEIGHBOURS + 1)[1][:, -1]))
    places = np.hstack([feet, weight * nominal.normals(asked)])
    beside, apart = _neighbours(places, places, GROUP_NEIGHBOURS + 1)
    beside, apart = beside[:, 1:], apart[:, 1:]
    alike = np.abs(values[asked][beside] - values[asked][:, None]) <= ALIKE_SLOPE * apart + ALIKE_SIGMAS * noise
    smooth, reach = np.count_nonzero(alike, axis=1) >= MIN_ALIKE_NEIGHBOURS, PART_REACH_SPACINGS * apart[:, -1]
    smooth[smooth] = _are_spread(feet[beside[smooth]])
    rows = _about(feet[smooth], reach[smooth], on, nominal)
    if np.count_nonzero(smooth) < MIN_GROUP_POINTS or len(rows) < GROUP_NEIGHBOURS:
        return asked[:0]
    part = np.hstack([nominal.feet[rows], weight * nominal.normals(rows)])
    nearest, away = _neighbours(part, places, GROUP_NEIGHBOURS)
    # What lies amid points on the part is a spike: noise, or a stray above a face that is as it should be.
    smooth &= away[:, -1] > apart[:, -1]
    step = np.abs(values[rows][nearest[:, 0]] - values[asked])
    joined = smooth & (away[:, 0] <= reach) & (step <= ALIKE_SLOPE * away[:, 0] + ALIKE_SIGMAS * noise)
    group = _hanging_together(beside, alike & smooth[:, None] & smooth[beside])
    sizes, joints = (np.bincount(group, weights=side, minlength=len(asked)) for side in (smooth, joined))
    of_the_part: IntArray = asked[smooth & ((sizes >= MIN_GROUP_POINTS) & (joints**2 >= sizes))[group]]
    return of_the_part


def _are_spread(feet: FloatArray) -> BoolArray:
    """Which of some sets of feet, (n, k, 3), lie on no line, (n,)."""
    spreads = np.linalg.svd(feet - feet.mean(axis=1, keepdims=True), compute_uv=False)
    return np.asarray(spreads[:, 1] > MAX_LINE_RATIO * spreads[:, 0])


def _about(feet: FloatArray, reach: FloatArray, on: BoolArray, nominal: Nominal) -> IntArray:
    """Rows of points on the part in the box about some feet, by as much as some of them reach."""
    if not len(feet):
        return np.zeros(0, dtype=np.int64)
    low, high = feet.min(axis=0) - reach.max(), feet.max(axis=0) + reach.max()
    return np.flatnonzero(on & ((nominal.feet >= low) & (nominal.feet <= high)).all(axis=1))


def _neighbours(places: FloatArray, asked: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
    """The nearest of some places to each asked, and how far they are, (m, count) each."""
    from scipy.spatial import cKDTree

    away, found = cKDTree(places).query(asked, k=count)
    return np.asarray(found), np.asarray(away)


def _hanging_together(beside: IntArray, linked: BoolArray) -> IntArray:
    """Group of each point, given its neighbours and with which of them it is linked, (n, k) each."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    one, two = np.nonzero(linked)[0], beside[linked]
    graph = coo_array((np.ones(len(one)), (one, two)), shape=(len(beside),) * 2)
    groups: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
    return groups
