"""Symmetries of a part as values: the turns that leave it as it is, and what they are called."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.search.rotations import SAME_AXIS_RAD, angle_of, axis_of, keeps_axis
from dqreg.solvers.motion_words import axis_words


@dataclasses.dataclass(frozen=True)
class Axis:
    """An axis about which the part may be turned without a change."""

    direction: FloatArray  # (3,): Unit vector; its largest component is positive
    point: FloatArray  # (3,): A place on it, in the target's frame
    order: int | None  # Equal places in one full turn; None where every angle is one (a solid of revolution)

    @property
    def words(self) -> str:
        """The symmetry in a sentence."""
        rotation = "any rotation" if self.order is None else f"a rotation of {360.0 / self.order:.4g} degrees"
        return f"the part looks the same after {rotation} about {axis_words(self.point, self.direction)}"


@dataclasses.dataclass(frozen=True)
class Symmetry:
    """Symmetries of a part."""

    axes: tuple[Axis, ...]  # Axes of turns, round ones first, then by falling order; empty for most parts
    mirrors: FloatArray  # (m, 3): Unit normals of mirror planes through ``centre``. They allow no second pose
    # (k, 4, 4): Poses of the part onto itself, but for the identity; of a round axis only those that are not turns
    # about it
    turns: FloatArray
    # (k, 4, 4): Poses of the part that leave most of it in place, the symmetries among them: what a search must tell
    # apart
    near: FloatArray
    centre: FloatArray  # (3,): Centre of the surface, which all symmetries leave in place

    def words_between(self, T_one: FloatArray, T_other: FloatArray) -> str:
        """The symmetry that turns one pose of the part into another, in words; "" if none does."""
        R = T_other[:3, :3] @ T_one[:3, :3].T
        for axis in self.axes:
            if keeps_axis(R, axis.direction):
                steps = angle_of(R) * (axis.order or 0) / (2.0 * np.pi)
                if abs(steps - round(steps)) < SAME_AXIS_RAD * (axis.order or 0):
                    return axis.words
                if axis.order is None:
                    return axis.words
        for T in self.turns:
            if angle_of(R @ T[:3, :3].T) < 2.0 * SAME_AXIS_RAD or self._up_to_round(R, T[:3, :3]):
                return Axis(axis_of(T[:3, :3]), self.centre, round(2.0 * np.pi / angle_of(T[:3, :3]))).words
        return ""

    def _up_to_round(self, R: FloatArray, turn: FloatArray) -> bool:
        around = [axis.direction for axis in self.axes if axis.order is None]
        return bool(around) and bool(np.linalg.norm((R - turn) @ around[0]) < 2.0 * SAME_AXIS_RAD)

    @property
    def words(self) -> tuple[str, ...]:
        """One sentence for each axis."""
        return tuple(axis.words for axis in self.axes)
