"""Pose graphs as g2o files, as GTSAM and Ceres' examples read them: written only.

The information is that of a twist, translation first and rotation in radians. (g2o itself counts rotations by the
vector of the quaternion, half of that.)
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.files.trajectories import positions_and_quaternions


def to_g2o(
    numbers: IntArray,
    poses: FloatArray,
    fixed: int,
    pairs: IntArray,
    relative: FloatArray,
    information: FloatArray,
) -> str:
    """Poses by their numbers, the number of the one that is held, and the relative poses with what is known of them.

    Shapes: numbers (n,), poses (n, 4, 4), pairs (m, 2), relative (m, 4, 4), T_first_second, information (m, 6, 6), of
    right increments, translation first.
    """
    lines = [f"VERTEX_SE3:QUAT {k} {place}" for k, place in zip(numbers, positions_and_quaternions(poses), strict=True)]
    lines.append(f"FIX {fixed}")
    for (i, j), place, held in zip(pairs, positions_and_quaternions(relative), information, strict=True):
        upper = " ".join(map(repr, held[np.triu_indices(6)].tolist()))
        lines.append(f"EDGE_SE3:QUAT {i} {j} {place} {upper}")
    return "\n".join(lines) + "\n"
