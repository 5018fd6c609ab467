"""The six independent motions of the part in words, the least held first."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import pose, twist
from dqreg.solvers.motion_words import Kind, Motion
from dqreg.trust.covariance import Information
from dqreg.trust.records import Direction

# A free motion is a turn if that much of its unit vector is one: an axis ten levers away still counts, rounding not.
FREE_TURN = 0.1
# One that is held is a turn if more than half of it is.
HELD_TURN = 0.5**0.5
# A motion held by fewer than this share of the points hangs on a detail.
FEW = 0.02


def observe_directions(information: Information) -> tuple[Direction, ...]:
    """How firmly each motion is held, and what it is.

    Parameters
    ----------
    information : Information
        From `information_of`.

    Returns
    -------
    tuple of Direction
        Six, the weakest first.

    Examples
    --------
    >>> info = Information(np.array([0.0, 1, 1, 1, 1, 1]), np.eye(6)[::-1].T, 100.0, 0.1, 2.0, np.zeros(3))
    >>> observe_directions(info)[0].words
    'unconstrained: translation along (0.00, 0.00, 1.00)'
    """
    free = information.free
    vectors = np.hstack([_untangled(information.vectors[:, free]), information.vectors[:, ~free]])
    directions = []
    for value, vector, is_free, carriers in zip(information.values, vectors.T, free, information.carriers, strict=True):
        share = FREE_TURN if is_free else HELD_TURN
        kind: Kind = "rotation" if np.linalg.norm(vector[:3]) >= share else "translation"
        motion = Motion.of(vector[:3] / information.lever, vector[3:], information.centre, kind)
        sigma, words = np.nan, f"unconstrained: {motion.words}"
        if not is_free:
            # Where most of the points say nothing, it matters how many do.
            few = carriers < FEW * information.weight
            only = f" is constrained by about {carriers:.0f} points only" if few else ""
            sigma, words = _sigma(information, value, vector), f"{motion.words}{only}"
        directions.append(Direction(float(value), sigma, words, motion.kind, motion.axis, motion.point))
    return tuple(directions)


def _sigma(information: Information, value: float, vector: FloatArray) -> float:
    if information.scatter is None:
        return float(information.sigma / np.sqrt(information.weight * value))
    return math.sqrt(max(float(vector @ information.scatter @ vector), 0.0))


def _untangled(free: FloatArray) -> FloatArray:
    # The free motions have one eigenvalue, zero, so their eigenvectors are any mixture. The basis with turns as large
    # as can be comes apart into pure turns and pure shifts: a cylinder spins and slides, and does not screw.
    _, _, mixture = np.linalg.svd(free[:3])
    untangled: FloatArray = free @ mixture.T
    return untangled


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
