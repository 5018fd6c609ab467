"""Symmetries of a part as values, found by a search or known beforehand: the rigid motions that put it onto itself."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid.rotations import angle_of, axis_of

# Axes closer than this are one.
SAME_AXIS_RAD = np.deg2rad(2.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Axis:
    """An axis about which the part may be rotated without a change."""

    direction: FloatArray  # (3,): Unit vector; its largest component is positive
    point: FloatArray  # (3,): A point on it, in the part's frame
    order: int | None  # Equal positions in one full turn; None where every angle is one (a solid of revolution)

    def moved(self, offset: FloatArray) -> Axis:
        """The same axis in a frame whose origin lies at ``-offset``."""
        return dataclasses.replace(self, point=self.point + offset)

    def is_kept_by(self, R: FloatArray) -> bool:
        """Whether a rotation leaves the direction as it is, to ``SAME_AXIS_RAD``."""
        return bool(np.linalg.norm(R @ self.direction - self.direction) < SAME_AXIS_RAD)


@dataclasses.dataclass(frozen=True, eq=False)
class Symmetry:
    """Motions of a part that leave its surface where it is, in the part's frame."""

    poses: FloatArray  # (k, 4, 4): Every such motion, or for a round part one of each kind; the identity comes first
    near: FloatArray  # (m, 4, 4): Motions that leave most of the part in place
    # Round axes first: any rotation about one is one more motion, before or after those of ``poses``. Of the others
    # those that a search has found, by falling order
    axes: tuple[Axis, ...] = ()
    centre: FloatArray = dataclasses.field(
        default_factory=lambda: np.zeros(3)
    )  # A point that all of them leave in place

    @property
    def axis(self) -> FloatArray | None:
        """Point and direction of the axis of a round part, (2, 3)."""
        found = next((axis for axis in self.axes if axis.order is None), None)
        return None if found is None else np.stack([found.point, found.direction])

    def between(self, T_one: FloatArray, T_other: FloatArray, within: float) -> Axis | None:
        """The axis about which one pose of the part is rotated into another; None if no symmetry does that.

        A symmetry leaves the centre where it is, here within a length: a period does not.
        """
        R = T_other[:3, :3] @ T_one[:3, :3].T
        centre = R @ (self.centre - T_one[:3, 3]) + T_other[:3, 3]
        if np.linalg.norm(centre - self.centre) > within:
            return None
        for axis in self.axes:
            if axis.is_kept_by(R):
                steps = angle_of(R) * (axis.order or 0) / (2.0 * np.pi)
                if axis.order is None or abs(steps - round(steps)) < SAME_AXIS_RAD * axis.order:
                    return axis
        for T in self.poses[1:]:
            turn = T[:3, :3]
            if angle_of(R @ turn.T) < 2.0 * SAME_AXIS_RAD or self._same_up_to_round(R, turn):
                return Axis(axis_of(turn), self.centre, round(2.0 * np.pi / angle_of(turn)))
        return None

    def _same_up_to_round(self, R: FloatArray, turn: FloatArray) -> bool:
        axis = self.axis
        return axis is not None and bool(np.linalg.norm((R - turn) @ axis[1]) < 2.0 * SAME_AXIS_RAD)
