"""Points of a scene on other objects than the part: where these happen to touch it at a pose, they say nothing of that.

Among neighbours of its own kind a strip of one of them on the placed part told it from an equally likely pose. The face
that the strip is of goes on off the part; faces of the part itself do not, at its pose.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.registration.problem.derived_values import Derived, Key
from dqreg.registration.problem.preparation import Prepared
from dqreg.search.poses import Poses
from dqreg.search.scoring import distances_at
from dqreg.trust.segments import MIN_SEGMENT_POINTS, smooth_segments

# Points of a scan of which segments are made.
SEGMENTED = 5_000
# Points are off a part beyond that share of its size, also at a pose that few points have refined.
OFF_DIAGONALS = 0.02
# Share of the points of a segment that lie off the part from which on it is of another object.
OTHER_SHARE = 0.5

# Of a problem: rows of points of a scan, and the smooth segment of each; -1 on none.
SEGMENTS: Key[tuple[IntArray, IntArray]] = Key()


def on_others(prepared: Prepared, derived: Derived, poses: FloatArray, points: FloatArray) -> BoolArray:
    """Which points of a scan, (n, 3), are on surface most of which lies off the part at all poses, (k, 4, 4).

    The segments of the scan are kept with what is derived of its problem.
    """
    scan, surface = prepared.scan, prepared.surface
    rows, labels = derived.once(SEGMENTS, lambda: _segments(scan.points), of=len(scan))
    off, known = OFF_DIAGONALS * surface.diagonal, labels >= 0
    apart = distances_at(Poses.of(poses), scan.points[rows], surface, off).min(axis=0) >= off
    count, of_others = np.bincount(labels[known]), np.bincount(labels[known], weights=apart[known])
    # The last one is for points on no segment: nothing says that they are of another object.
    others = np.append((count >= MIN_SEGMENT_POINTS) & (of_others > OTHER_SHARE * count), False)
    return np.asarray(others[labels[NeighbourTree(scan.points[rows]).nearest(points, 1)[0][:, 0]]])


def _segments(points: FloatArray) -> tuple[IntArray, IntArray]:
    rows = sample_rows(len(points), SEGMENTED)
    return rows, smooth_segments(points[rows])
