"""The motion of the sensor during a sweep, undone along one screw."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import twist

# Angle below which series are used instead of quotients: their next terms are below the last digit.
SMALL = 1e-2


def swept(points: FloatArray, back: FloatArray, motion: FloatArray, *, directions: bool = False) -> FloatArray:
    """Points, or directions, of a sweep as they are seen at its end, (n, 3).

    ``back`` tells the time of each, from -1 at the beginning of the sweep to 0 at its end. With the twist ``(w, v)`` of
    the motion each is moved by ``exp(back (w, v))``:

        x + a w x x + b w x (w x x) + back v + b w x v + c w x (w x v)
    """
    step = twist.log(motion)
    turn, shift = step[:3], np.zeros(3) if directions else step[3:]
    angle = float(np.linalg.norm(turn))
    at = back * angle
    if angle > SMALL:
        a, b, c = np.sin(at) / angle, (1.0 - np.cos(at)) / angle**2, (at - np.sin(at)) / angle**3
    else:
        square = at * at
        a = back * (1.0 - square / 6.0 * (1.0 - square / 20.0))
        b = back * back * (0.5 - square / 24.0 * (1.0 - square / 30.0))
        c = back**3 * (1.0 / 6.0 - square / 120.0 * (1.0 - square / 42.0))
    x, y, z = turn
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    once = points @ across.T
    moved: FloatArray = points + a[:, None] * once + b[:, None] * (once @ across.T)
    if shift.any():
        turned = across @ shift
        moved += np.outer(back, shift) + np.outer(b, turned) + np.outer(c, across @ turned)
    return moved
