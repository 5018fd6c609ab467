"""Anderson acceleration of the rounds of the joint refinement, over the poses of all scans at once.

New nearest points hold the scans back along motions that little constrains: what is left shrinks by a constant factor a
round, in places by a tenth only. The last few rounds extrapolate to the limit (Anderson 1965; for ICP Pavlov et al.
2018). There is no energy to guard it, as weights and reaches follow the distances: the length of the plain step does.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.icp.acceleration import limit_of
from dqreg.rigid import pose

WINDOW_STEPS = 5
# Directions of the least squares weaker than this against the strongest are noise of the nearest points.
MIN_DIRECTION_RATIO = 1e-2
# A plain step that grows by more than this after an extrapolation takes it back.
MAX_STEP_GROWTH = 1.5


class JointAnderson:
    """Extrapolates the poses of all free bodies; one instance serves one run."""

    def __init__(self, free: IntArray, radii: FloatArray) -> None:
        # A rotation counts by the way of a body's rim.
        self._free, self._units = free, np.repeat(1.0 / radii[free][:, None], 6, axis=1)
        self._units[:, 3:] = 1.0
        self._base = np.zeros((0, 4, 4))
        self.restart()

    def restart(self) -> None:
        """Forget the past, for example because the points have changed."""
        self._positions: list[FloatArray] = []
        self._steps: list[FloatArray] = []
        self._plain: FloatArray | None = None

    def propose(self, T: FloatArray, T_next: FloatArray) -> FloatArray:
        """Next poses from T, given those of the plain round. Shapes: all (n, 4, 4)."""
        if not len(self._free):
            return T_next
        if not self._positions:
            self._base = T[self._free].copy()
        position, target = self._coordinates(T), self._coordinates(T_next)
        step = target - position
        if self._plain is not None and np.linalg.norm(step) > MAX_STEP_GROWTH * np.linalg.norm(self._steps[-1]):
            back = self._plain
            self.restart()
            return back
        self._positions.append(position)
        self._steps.append(step)
        del self._positions[: -WINDOW_STEPS - 1], self._steps[: -WINDOW_STEPS - 1]
        self._plain = None
        if len(self._steps) < 2:
            return T_next
        self._plain = T_next
        found = T_next.copy()
        found[self._free] = self._poses(limit_of(self._positions, self._steps, MIN_DIRECTION_RATIO))
        return found

    def _coordinates(self, T: FloatArray) -> FloatArray:
        """Twists from the first poses, each about its body's first origin."""
        there = pose.from_parts(np.eye(3), -self._base[:, :3, 3])
        twists = pose.log(there @ T[self._free] @ pose.inverse(there @ self._base))
        return np.asarray((twists / self._units).ravel())

    def _poses(self, coordinates: FloatArray) -> FloatArray:
        there = pose.from_parts(np.eye(3), -self._base[:, :3, 3])
        return np.asarray(pose.inverse(there) @ pose.exp(coordinates.reshape(-1, 6) * self._units) @ there @ self._base)
