"""All six motions, as a chart of `descend`: the plain twin of the compiled search for a local minimum."""

from __future__ import annotations

import dataclasses
from typing import Self

from dqreg._arrays import FloatArray
from dqreg.rigid import pose, rotations
from dqreg.solvers.quadratic import QuadraticForm, Slopes, split_derivatives


@dataclasses.dataclass(frozen=True)
class FreeChart:
    """All six motions: a rotation about a centre, then a translation, along the target's axes."""

    pose: FloatArray  # (4, 4): T_target_source
    centre: FloatArray  # (3,): The target origin of the form
    turns: int = 3

    def slopes(self, form: QuadraticForm) -> Slopes:
        """See `split_derivatives`."""
        y = form.coordinates(self.pose)
        return split_derivatives(form, self.pose[:3, :3], y, y[9:12] + form.origin_target - self.centre)

    def moved(self, step: FloatArray) -> Self:
        """The chart after a step, (6,)."""
        turn = pose.about(pose.from_parts(rotations.from_rotation_vector(step[:3]), step[3:]), self.centre)
        return dataclasses.replace(self, pose=turn @ self.pose)
