"""Points of a sweep as they are seen at its end, along one screw."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled

# Angle below which series are used instead of sines: their next terms are below the last digit.
SMALL = 0.1
# Of each term of the series of sine over angle to the one before, and of one less cosine.
P, Q = (1.0 / 6.0, 1.0 / 20.0, 1.0 / 42.0, 1.0 / 72.0), (1.0 / 24.0, 1.0 / 30.0, 1.0 / 56.0, 1.0 / 90.0)


@compiled
def swept_rows(
    first: int, last: int, points: FloatArray, back: FloatArray, step: FloatArray, moved: FloatArray
) -> None:
    """Write ``exp(s (w, v)) x`` for points x of times s and a twist (w, v), rotation first, from row first to last.

    x + a w x x + b w x (w x x) + s v + b w x v + c w x (w x v)
    """
    wx, wy, wz, vx, vy, vz = step[0], step[1], step[2], step[3], step[4], step[5]
    angle = np.sqrt(wx * wx + wy * wy + wz * wz)
    for i in range(first, last):
        s, x, y, z = back[i], points[i, 0], points[i, 1], points[i, 2]
        at = s * angle
        if abs(at) > SMALL:
            a, b = np.sin(at) / angle, (1.0 - np.cos(at)) / angle**2
            c = (at - np.sin(at)) / angle**3
        else:
            square = at * at
            a = s * (1.0 - square * P[0] * (1.0 - square * P[1] * (1.0 - square * P[2] * (1.0 - square * P[3]))))
            b = s * s * (0.5 - square * Q[0] * (1.0 - square * Q[1] * (1.0 - square * Q[2] * (1.0 - square * Q[3]))))
            c = s * s * s * P[0] * (1.0 - square * P[1] * (1.0 - square * P[2] * (1.0 - square * P[3])))
        # w x of: a x + b (w x x + v) + c (w x v), from the inside.
        px, py, pz = wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx
        qx, qy, qz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
        ux, uy, uz = a * x + b * (qx + vx) + c * px, a * y + b * (qy + vy) + c * py, a * z + b * (qz + vz) + c * pz
        moved[i, 0] = x + s * vx + wy * uz - wz * uy
        moved[i, 1] = y + s * vy + wz * ux - wx * uz
        moved[i, 2] = z + s * vz + wx * uy - wy * ux
