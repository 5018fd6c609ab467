"""Rotation matrices as a search for symmetries needs them: axis, angle, and a spread over all there are."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid.rotations import evenly_spread

# Axes closer than this are one.
SAME_AXIS_RAD = np.deg2rad(2.0)


def keeps_axis(R: FloatArray, direction: FloatArray) -> bool:
    """Whether a rotation leaves a direction where it is, to ``SAME_AXIS_RAD``."""
    return bool(np.linalg.norm(R @ direction - direction) < SAME_AXIS_RAD)


def angle_of(R: FloatArray) -> float:
    """Angle of a rotation matrix, (3, 3), radians."""
    # By the chord: exact for small angles, where the cosine is not.
    return float(2.0 * np.arcsin(min(np.linalg.norm(R - np.eye(3)) / np.sqrt(8.0), 1.0)))


def axis_of(R: FloatArray) -> FloatArray:
    """Axis of a rotation matrix, its largest component positive, (3,)."""
    # The axis is what R + R^T stretches most, for half-turns as well.
    return canonical(np.linalg.eigh(R + R.T)[1][:, 2])


def canonical(direction: FloatArray) -> FloatArray:
    """A direction or its opposite, so that the largest component is positive."""
    turned: FloatArray = direction * np.sign(direction[np.abs(direction).argmax()])
    return turned


def all_round(count: int) -> FloatArray:
    """Rotations spread evenly over all there are, (count, 3, 3)."""
    w, x, y, z = evenly_spread(count).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
