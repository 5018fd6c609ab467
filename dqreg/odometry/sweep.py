"""The motion of the sensor during a sweep, undone along one screw."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import single_pose

# Rows that a thread takes in one go: after each it asks for the interpreter, which the other one may be at.
CHUNK_ROWS = 16_384


def swept(points: FloatArray, back: FloatArray, motion: FloatArray, *, directions: bool = False) -> FloatArray:
    """Points, or directions, of a sweep as they are seen at its end, (n, 3).

    ``back`` tells the time of each, from -1 at the beginning of the sweep to 0 at its end.
    """
    step = single_pose.log(motion[:3, :3], motion[:3, 3])
    if directions:
        step[3:] = 0.0
    return swept_by(points, back, step)


def swept_by(points: FloatArray, back: FloatArray, step: FloatArray) -> FloatArray:
    """The same by the twist of the motion, (6,)."""
    from dqreg.kernels.maps.swept_rows import swept_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    moved = np.zeros(points.shape)
    over_chunks(swept_rows, len(points), as_plain(points), as_plain(back), step, moved, chunk=CHUNK_ROWS)
    return moved
