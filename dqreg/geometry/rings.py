"""Whether the points of a cloud lie in rings, as those of a LiDAR that turns."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.boundary import LINE
from dqreg.geometry.normals import sample_rows

# Points whose neighbours are looked at, in runs along the order of space: so many runs, points a run, and points amid
# each that are asked. A run is wide enough to hold the neighbours of these, so that no tree is built for a glance.
RUN_COUNT, RUN_POINTS, ASKED_A_RUN = 40, 200, 5
# Neighbours that are on a point's own ring where rings are farther apart than the points on one.
NEIGHBOUR_COUNT = 8
# A cloud of which more than this share has its neighbours along a line lies in rings. Sweeps of 16 to 64 rings in rooms
# and on a road came to 0.2 to 0.9, cameras, range scans and simulated views of parts to 0.09 at most.
RING_SHARE = 0.15


def lie_in_rings(points: FloatArray, order: IntArray) -> bool:
    """Whether points, (n, 3), lie in rings; an order of space, (n,), tells which are near each other."""
    from dqreg.kernels.rims import line_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    length = min(RUN_POINTS, len(order))
    if length <= NEIGHBOUR_COUNT:
        return False
    begins = sample_rows(len(order) - length + 1, RUN_COUNT)
    runs = order[begins[:, None] + np.arange(length)]
    asked = (length - ASKED_A_RUN) // 2 + np.arange(ASKED_A_RUN)
    places = points[runs]
    squares = ((places[:, asked, None] - places[:, None]) ** 2).sum(axis=-1)
    nearest = np.argsort(squares, axis=-1, kind="stable")[..., : NEIGHBOUR_COUNT + 1]
    # Copies of one point are no line.
    farthest = np.take_along_axis(squares, nearest[..., -1:], axis=-1)[..., 0]
    rows = np.take_along_axis(runs[:, None], nearest, axis=-1)[farthest > 0.0]
    if not len(rows):
        return False
    found = np.zeros(len(rows), dtype=bool)
    over_chunks(line_rows, len(rows), as_plain(points), rows.astype(np.int32), LINE, found)
    return float(found.mean()) > RING_SHARE
