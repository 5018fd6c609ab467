"""Frames on the target's side, in which motions are named and covariances given."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg.arrays import FloatArray, as_float, as_pose, require_finite
from dqreg.errors import InputError
from dqreg.rigid import pose


def as_frame(value: ArrayLike | None, name: str) -> FloatArray:
    """T_target_frame of a 4x4 matrix, of its origin alone, or of nothing.

    >>> as_frame([1, 2, 3], "frame")[:3, 3].tolist()
    [1.0, 2.0, 3.0]
    """
    if value is None:
        return np.eye(4)
    array = as_float(value, name)
    if array.shape == (3,):
        require_finite(array, name)
        return pose.from_parts(np.eye(3), array)
    if array.shape != (4, 4):
        raise InputError(f"{name} must be a 4x4 pose T_target_frame, or its origin, three numbers; got {array.shape}")
    return as_pose(array, name)
