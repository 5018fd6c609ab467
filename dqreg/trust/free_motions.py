"""Motions that nothing holds are none of the fit's business: the pose keeps them as the start had them."""

from __future__ import annotations

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.rigid import pose, twist
from dqreg.trust.covariance import Information

# Turns do not commute: what one round leaves over is of second order.
ROUNDS = 3


def without_free_motion(T_target_source: FloatArray, T_start: FloatArray, information: Information) -> FloatArray:
    """The pose with its motion from the start taken out along the free motions.

    On its way the loop drifts along them: facets and far points seem to hold a round part against a spin.

    Parameters
    ----------
    T_target_source, T_start : ndarray, (4, 4)
        Pose and start, in the frame whose origin is the centre of the information's twists.
    information : Information
        What the matches hold.

    Returns
    -------
    ndarray, (4, 4)
        The same pose where nothing is free.

    Examples
    --------
    >>> only_z = Information(np.array([0.0, 1, 1, 1, 1, 1]), np.eye(6)[::-1].T, 100.0, 0.1, 2.0, np.zeros(3))
    >>> drifted = pose.from_parts(np.eye(3), [0.5, 0.0, 3.0])
    >>> without_free_motion(drifted, np.eye(4), only_z)[:3, 3].tolist()
    [0.5, 0.0, 0.0]
    """
    free = information.vectors[:, information.free]
    scale = np.r_[[information.lever] * 3, [1.0] * 3]
    T = T_target_source
    for _ in range(ROUNDS if free.shape[1] else 0):
        moved = twist.log(T @ pose.inverse(T_start)) * scale
        T = twist.exp(-free @ (free.T @ moved) / scale) @ T
    return T
