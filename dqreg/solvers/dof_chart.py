"""Motions away from a reference pose, in a frame: a rotation about the frame's origin, then a translation.

The rotation is a unit quaternion whose vector part has zeros where a rotation is locked. Such quaternions are a great
sphere of all unit quaternions, and great circles within it are rotations about a constant axis: so a step along a
tangent of it stays on it exactly.
"""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Any, Self

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import quaternion
from dqreg.solvers.quadratic import QuadraticForm, Slopes, split_derivatives

Flags = tuple[bool, bool, bool]


@dataclasses.dataclass(frozen=True, eq=False)
class FrameMotion:
    """Rotation about the frame's origin, then translation."""

    q: FloatArray  # (4,): Unit quaternion w, x, y, z along the frame's axes
    t: FloatArray  # (3,): Translation along the frame's axes

    def within(self, turns: Flags, shifts: Flags) -> FrameMotion:
        """The same without its locked parts."""
        q = self.q * (1.0, *turns)
        size = math.sqrt(float(q @ q))
        # A half-turn about a locked axis is as far from all allowed rotations: none is as good as any.
        q = q / size if size > 0.0 else np.array([1.0, 0.0, 0.0, 0.0])
        return FrameMotion(q, self.t * shifts)


def relative(frame: FloatArray, T: FloatArray, T_reference: FloatArray) -> FrameMotion:
    """The motion from a reference pose to a pose."""
    axes, origin = frame[:3, :3], frame[:3, 3]
    q = quaternion.from_matrix(axes.T @ T[:3, :3] @ T_reference[:3, :3].T @ axes)
    arm = axes.T @ (T_reference[:3, 3] - origin)
    return FrameMotion(q, axes.T @ (T[:3, 3] - T_reference[:3, 3]) - turned(q) @ arm)


def compose(frame: FloatArray, motion: FrameMotion, T_reference: FloatArray) -> FloatArray:
    """The pose that a motion leads to."""
    axes, origin = frame[:3, :3], frame[:3, 3]
    # All by differences from the reference: what is locked keeps every digit, wherever the origins are.
    change = axes @ turned(motion.q) @ axes.T
    T = T_reference.copy()
    T[:3, :3] += change @ T_reference[:3, :3]
    T[:3, 3] += change @ (T_reference[:3, 3] - origin) + axes @ motion.t
    return T


def turned(q: FloatArray) -> FloatArray:
    """``R(q) - I`` of unit quaternions, exact for small rotations. Shapes: q (..., 4), returns (..., 3, 3)."""
    if q.ndim == 1:
        # Plain numbers: the loop calls this once a step, and arrays of one would cost ten times as much.
        return np.array(_entries(*q.tolist()))
    return np.moveaxis(np.array(_entries(*np.moveaxis(q, -1, 0))), (0, 1), (-2, -1))


def _entries(w: Any, x: Any, y: Any, z: Any) -> tuple[tuple[Any, Any, Any], ...]:
    return (
        (-2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), -2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), -2.0 * (x * x + y * y)),
    )


def tangent(q: FloatArray, turns: Flags) -> FloatArray:
    """Axes about which a further rotation stays among the allowed ones. Shapes: q (4,), returns (3, k)."""
    free = np.array(turns)
    if free.sum() != 2:
        # All axes, or the only one: rotations about one axis commute.
        return np.eye(3)[:, free]
    subspace = np.eye(4)[[0, *(1 + np.flatnonzero(free))]]
    across = np.linalg.svd((subspace @ q)[None, :])[2][1:] @ subspace
    # The axis of a great circle through q towards d is the vector part of d q*.
    axes: FloatArray = quaternion.multiply(across, quaternion.conjugate(q))[:, 1:].T
    return axes


@dataclasses.dataclass(frozen=True, eq=False)
class LockedChart:
    """A pose that an allowed motion leads to, and its allowed steps, for `descend`."""

    # frame, reference: (4, 4): T_target_frame and the pose that the motion starts from
    frame: FloatArray
    reference: FloatArray
    freely: tuple[Flags, Flags]  # Which rotations and which translations are free
    motion: FrameMotion  # An allowed one

    @cached_property
    def pose(self) -> FloatArray:
        """T_target_source, (4, 4)."""
        return compose(self.frame, self.motion, self.reference)

    @property
    def turns(self) -> int:
        """Number of free rotations."""
        return sum(self.freely[0])

    @cached_property
    def _axes(self) -> FloatArray:
        return tangent(self.motion.q, self.freely[0])

    @property
    def pivot(self) -> FloatArray:
        """The moved origin of the frame: rotations are about this point."""
        carried: FloatArray = self.frame[:3, 3] + self.frame[:3, :3] @ self.motion.t
        return carried

    @property
    def basis(self) -> FloatArray:
        """Steps as rotations about the pivot and translations, along the target's axes, (6, k)."""
        axes = self.frame[:3, :3]
        basis = np.zeros((6, self.turns + sum(self.freely[1])))
        basis[:3, : self.turns] = axes @ self._axes
        basis[3:, self.turns :] = axes[:, list(self.freely[1])]
        return basis

    def slopes(self, form: QuadraticForm) -> Slopes:
        """Gradient, Hessian and its part from squares along the allowed steps."""
        y = form.coordinates(self.pose)
        arm = y[9:12] + form.origin_target - self.pivot
        gradient, hessian, squares = split_derivatives(form, self.pose[:3, :3], y, arm)
        B = self.basis
        return B.T @ gradient, B.T @ hessian @ B, B.T @ squares @ B

    def moved(self, step: FloatArray) -> Self:
        """The chart after allowed steps, (k,)."""
        half = np.zeros(4)
        half[1:] = 0.5 * (self._axes @ step[: self.turns])
        t = self.motion.t.copy()
        t[list(self.freely[1])] += step[self.turns :]
        moved = FrameMotion(quaternion.multiply(quaternion.exp(half), self.motion.q), t)
        # Rounding is taken out of the locked parts, so that they stay zero to the last bit.
        return dataclasses.replace(self, motion=moved.within(*self.freely))
