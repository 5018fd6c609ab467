"""Anderson acceleration of the loop's fixed-point iteration, on screw coordinates, guarded by the energy.

Closed-form steps with closest points converge linearly: tangential sliding shrinks by a constant factor an
iteration. The last few steps extrapolate to the limit (Anderson 1965; for ICP Pavlov et al. 2018).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import single_pose

WINDOW_STEPS = 5
# Least-squares directions weaker than this against the strongest are noise.
MIN_DIRECTION_RATIO = 1e-6
# Rounding of the energy, not a rise.
ENERGY_ROUNDING = 1e-12
# Normals bias the fixed point a little off the lowest distances; up to this fraction the energy may rise, as long as
# the steps get shorter. Without it, half of the extrapolations near the end are rejected for nothing. Planes descend
# another cost than the distances, and raised these by 0.6 % on a road: where any rise was let pass, some pairs of views
# ran off along what hardly holds them.
TOLERATED_RISE, TOLERATED_RISE_OF_PLANES = 1e-3, 1e-2


class Anderson:
    """Extrapolates poses; one instance serves one run.

    Poses are written as twists relative to a reference, with the rotation about the middle of the moved points and the
    translation in units of their size, so that all six numbers are of one kind.
    """

    def __init__(
        self, reference: FloatArray, centre: FloatArray, size: float, tolerated: float = TOLERATED_RISE
    ) -> None:
        self._tolerated = tolerated
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

    def taken_back(self, T: FloatArray, T_next: FloatArray, energy: float) -> FloatArray | None:
        """Plain step before the extrapolation to T, where that is rejected; None where it holds.

        Given the pose that the plain iteration comes to from T, and the energy at T.
        """
        position, target = self._coordinates(T), self._coordinates(T_next)
        if self._plain is not None:
            shorter = np.linalg.norm(target - position) < np.linalg.norm(self._steps[-1])
            if energy > self._energy * (1.0 + (self._tolerated if shorter else ENERGY_ROUNDING)):
                back = self._plain
                self.restart()
                return back
        self._positions.append(position)
        self._steps.append(target - position)
        del self._positions[: -WINDOW_STEPS - 1], self._steps[: -WINDOW_STEPS - 1]
        self._energy, self._plain = energy, None
        return None

    def ahead(self, T_next: FloatArray) -> FloatArray:
        """Where to go on from the end of the last plain iteration, once it is known that the loop does."""
        if len(self._steps) < 2:
            return T_next
        self._plain = T_next
        return self._pose(limit_of(self._positions, self._steps, MIN_DIRECTION_RATIO))

    def _coordinates(self, T: FloatArray) -> FloatArray:
        T_change = self._back @ T @ self._off_base
        coordinates: FloatArray = single_pose.log(T_change[:3, :3], T_change[:3, 3]) / self._units
        return coordinates

    def _pose(self, coordinates: FloatArray) -> FloatArray:
        T: FloatArray = self._frame @ single_pose.exp(coordinates * self._units) @ self._base
        return T


def limit_of(positions: Sequence[FloatArray], steps: Sequence[FloatArray], cutoff: float) -> FloatArray:
    """Where the mix of the last positions lies of which the steps cancel best. Shapes: each (k,), returns (k,)."""
    step_changes, position_changes = np.diff(steps, axis=0).T, np.diff(positions, axis=0).T
    mix = np.linalg.lstsq(step_changes, steps[-1], rcond=cutoff)[0]
    limit: FloatArray = positions[-1] + steps[-1] - (position_changes + step_changes) @ mix
    return limit
