"""Anderson acceleration of the loop's fixed-point iteration, on screw coordinates, guarded by the energy.

Closed-form steps with closest points converge linearly: tangential sliding shrinks by a constant factor an
iteration. The last few steps extrapolate to the limit (Anderson 1965; for ICP Pavlov et al. 2018).
"""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray

WINDOW = 5
# Least-squares directions weaker than this against the strongest are noise.
CUTOFF = 1e-6
# Angle below which the next terms of the series are beyond the last digit.
SMALL = 1e-3
# Rounding of the energy, not a rise.
SLACK = 1e-12
# Normals bias the fixed point a little off the lowest distances; up to this fraction the energy may rise, as long as
# the steps get shorter. Without it, half of the extrapolations near the end are rejected for nothing.
TOLERATED = 1e-3


class Anderson:
    """Extrapolates poses; one instance serves one run.

    Poses are written as twists relative to a reference, with the rotation about the middle of the moved points and the
    translation in units of their size, so that all six numbers are of one kind.
    """

    def __init__(self, reference: FloatArray, centre: FloatArray, size: float) -> None:
        self._frame, self._back = np.eye(4), np.eye(4)
        self._frame[:3, 3] = reference[:3, :3] @ centre + reference[:3, 3]
        self._back[:3, 3] = -self._frame[:3, 3]
        self._base = self._back @ reference
        R, t = self._base[:3, :3], self._base[:3, 3]
        self._off_base = np.eye(4)
        self._off_base[:3, :3], self._off_base[:3, 3] = R.T, -R.T @ t
        self._units = np.array([1.0, 1.0, 1.0, size, size, size])
        self.restart()

    def restart(self) -> None:
        """Forget the past, for example because the cost itself has changed."""
        self._positions: list[FloatArray] = []
        self._steps: list[FloatArray] = []
        self._plain: FloatArray | None = None
        self._energy = np.inf

    def propose(self, T: FloatArray, T_next: FloatArray, energy: float) -> tuple[FloatArray, bool]:
        """Next pose from T, given that of the plain iteration; False where the last extrapolation is rejected."""
        position, target = self._coordinates(T), self._coordinates(T_next)
        if self._plain is not None:
            shorter = np.linalg.norm(target - position) < np.linalg.norm(self._steps[-1])
            if energy > self._energy * (1.0 + (TOLERATED if shorter else SLACK)):
                back = self._plain
                self.restart()
                return back, False
        self._positions.append(position)
        self._steps.append(target - position)
        del self._positions[: -WINDOW - 1], self._steps[: -WINDOW - 1]
        self._energy, self._plain = energy, None
        if len(self._steps) < 2:
            return T_next, True
        self._plain = T_next
        step_changes = np.diff(self._steps, axis=0).T
        position_changes = np.diff(self._positions, axis=0).T
        mix = np.linalg.lstsq(step_changes, self._steps[-1], rcond=CUTOFF)[0]
        return self._pose(target - (position_changes + step_changes) @ mix), True

    def _coordinates(self, T: FloatArray) -> FloatArray:
        coordinates: FloatArray = twist_of(self._back @ T @ self._off_base) / self._units
        return coordinates

    def _pose(self, coordinates: FloatArray) -> FloatArray:
        T: FloatArray = self._frame @ pose_of(coordinates * self._units) @ self._base
        return T


def twist_of(T: FloatArray) -> FloatArray:
    """`rigid.twist.log` of one pose, number by number: for a single one NumPy's calls take fifty times as long."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = T.tolist()
    # The quaternion by its largest component.
    squares = (1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i)
    k = squares.index(max(squares))
    found = (
        (squares[0], h - f, c - g, d - b),
        (h - f, squares[1], b + d, c + g),
        (c - g, b + d, squares[2], f + h),
        (d - b, c + g, f + h, squares[3]),
    )[k]
    length = math.hypot(*found)
    sign = -1.0 if found[0] < 0.0 else 1.0
    q, p, r, s = (sign * value / length for value in found)
    sine = math.sqrt(p * p + r * r + s * s)
    angle = 2.0 * math.atan2(sine, q)
    factor = angle / sine if sine > 0.0 else 2.0
    u, v, w = factor * p, factor * r, factor * s
    # Of the inverse Jacobian ``I - [w x] / 2 + m [w x]^2``, by its series where the sines cancel.
    half = 0.5 * angle
    m = (1.0 - half / math.tan(half)) / angle**2 if angle > SMALL else 1.0 / 12.0 + angle**2 / 720.0
    cross = v * z - w * y, w * x - u * z, u * y - v * x
    twice = v * cross[2] - w * cross[1], w * cross[0] - u * cross[2], u * cross[1] - v * cross[0]
    moved = (t - 0.5 * c1 + m * c2 for t, c1, c2 in zip((x, y, z), cross, twice, strict=True))
    return np.array([u, v, w, *moved])


def pose_of(twist: FloatArray) -> FloatArray:
    """`rigid.twist.exp` of one twist."""
    u, v, w, x, y, z = twist.tolist()
    angle = math.sqrt(u * u + v * v + w * w)
    small = angle <= SMALL
    one = 1.0 - angle**2 / 6.0 if small else math.sin(angle) / angle
    two = 0.5 - angle**2 / 24.0 if small else 2.0 * (math.sin(0.5 * angle) / angle) ** 2
    three = 1.0 / 6.0 - angle**2 / 120.0 if small else (1.0 - one) / angle**2
    W = np.array([[0.0, -w, v], [w, 0.0, -u], [-v, u, 0.0]])
    square = W @ W
    T = np.eye(4)
    T[:3, :3] += one * W + two * square
    T[:3, 3] = (np.eye(3) + two * W + three * square) @ (x, y, z)
    return T
