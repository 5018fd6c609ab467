"""What follows from an information: covariance, the six motions, and the pose without its free ones."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import pose, twist
from dqreg.rigid.twist import scaling_by
from dqreg.solvers.motion_words import Kind, Motion
from dqreg.trust.information import Information
from dqreg.trust.records import Direction

# A coordinate takes part in a free motion from this fraction on: less of it is the noise of the fit, and half a turn
# about an axis so far aside would displace the centre by three such fractions of the part.
TOUCHED = 1e-4
# The same in standard deviations of the coordinates of free motions, where the normals are estimates: neighbours share
# their errors. Of cylinders, planes and angles as two clouds none came above 2.7.
TILTED = 5.0
# A free motion is a rotation if that much of its unit vector is one: an axis ten levers away counts, rounding does not.
FREE_ROTATION = 0.1
# One whose axis is so far away that it turns no displacement on the part by more than this is told as a translation.
TOLD_ROTATION_RAD = math.radians(10.0)
# One that is constrained is a rotation if more than half of it is.
CONSTRAINED_ROTATION = 0.5**0.5
# A motion constrained by fewer than this fraction of the points depends on a detail.
FEW = 0.02
# The least information to divide by.
TINY = float(np.finfo(np.float64).tiny)


def covariance_of(information: Information) -> FloatArray:
    """Covariance of the twist (rotation vector, translation) about the centre, as a left increment.

    The scatter where it was estimated; else ``sigma^2 (J^T W J)^-1``, as if all correspondences were independent.

    Parameters
    ----------
    information : Information
        From `information_of`.

    Returns
    -------
    ndarray, (6, 6)
        Symmetric, rad^2 and length^2; NaN in the rows and columns that a free motion takes part in.

    Examples
    --------
    >>> held = Information(np.ones(6), np.eye(6), 100.0, 0.1, 2.0, np.zeros(3))
    >>> np.sqrt(np.diag(covariance_of(held))).tolist()
    [0.005, 0.005, 0.005, 0.01, 0.01, 0.01]
    """
    scaled = information.spread
    free = information.vectors[:, information.free]
    if math.isfinite(information.by_rims):
        scaled = scaled + information.by_rims**2 * free @ free.T
        free = free[:, :0]
    unscale = scaling_by(1.0 / information.lever)
    covariance: FloatArray = scaled * unscale[:, None] * unscale
    if not free.shape[1]:
        return covariance
    touched = (np.abs(free) > np.maximum(TOUCHED, TILTED * information.tilt)[:, None]).any(axis=1)
    covariance[touched] = np.nan
    covariance[:, touched] = np.nan
    return covariance


def partial_information_of(information: Information) -> FloatArray | None:
    """Inverse of the covariance along the motions that are held, (6, 6), 0 along free ones; None without noise."""
    held = ~information.free
    vectors = information.vectors[:, held]
    spread = np.diag(information.sigma**2 / (information.values[held] * information.weight))
    if information.scatter is not None:
        spread = vectors.T @ information.scatter @ vectors
    if information.vectors.shape[1] < 6 or np.linalg.matrix_rank(spread, hermitian=True) != held.sum():
        return None
    scaled = vectors @ np.linalg.inv(spread) @ vectors.T
    scale = scaling_by(information.lever)
    return np.asarray(0.5 * (scaled + scaled.T) * scale[:, None] * scale)


def observe_directions(information: Information, units: str | None = None) -> tuple[Direction, ...]:
    """The six independent motions of the part, and how well each is constrained.

    Parameters
    ----------
    information : Information
        From `information_of`.
    units : str, optional
        Length unit, for words.

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
    vectors = information.vectors
    if free.any():
        vectors = np.hstack([_separated(vectors[:, free]), vectors[:, ~free]])
    directions, centre, lever = [], information.centre.tolist(), information.lever
    columns = information.values, free, information.carriers, information.beforehand[: len(free)]
    known = zip(
        vectors.T.tolist(), _sigmas(information, vectors), *(column.tolist() for column in columns), strict=True
    )
    for vector, sigma, value, is_free, carriers, beforehand in known:
        share = FREE_ROTATION if is_free else CONSTRAINED_ROTATION
        kind: Kind = "rotation" if math.hypot(*vector[:3]) >= share else "translation"
        motion = Motion.of([x / lever for x in vector[:3]] + vector[3:], centre, kind)
        told = _told(motion, vector, centre).words_in(units) if is_free else motion.words_in(units)
        words = f"unconstrained: {told}"
        if is_free and math.isfinite(information.by_rims):
            words = f"{told} is constrained by the rims of the target only"
        elif not is_free:
            # Where most of the points add nothing, it matters how many do.
            few = carriers < FEW * information.weight
            only = f" is constrained by about {carriers:.0f} points only" if few else ""
            only = " is constrained by the prior only" if beforehand else only
            words = f"{told}{only}"
        directions.append(Direction(value, sigma, words, motion.kind, motion.axis, motion.point))
    return tuple(directions)


def _told(motion: Motion, vector: list[float], centre: list[float]) -> Motion:
    """A free motion as it displaces the part: the decisions on a rotation about a far axis stay those on a rotation."""
    turned = math.atan2(math.hypot(*vector[:3]), math.hypot(*vector[3:]))
    return Motion.of(vector, centre, "translation") if turned <= TOLD_ROTATION_RAD else motion


def _sigmas(information: Information, vectors: FloatArray) -> list[float]:
    """Standard deviation along each of the motions, (6, k) one a column; of a free one by the rims, NaN without."""
    if information.scatter is None:
        spreads = information.sigma / np.sqrt(np.maximum(information.weight * information.values, TINY))
    else:
        spreads = np.sqrt(np.maximum(np.einsum("ij,ij->j", vectors, information.scatter @ vectors), 0.0))
    found: list[float] = np.where(information.free, information.by_rims, spreads).tolist()
    return found


def _separated(free: FloatArray) -> FloatArray:
    # The free motions have one eigenvalue, zero, so their eigenvectors are any mixture. The basis with the largest
    # rotations separates into pure rotations and pure translations: those of a cylinder, and no screws.
    _, _, mixture = np.linalg.svd(free[:3])
    separated: FloatArray = free @ mixture.T
    return separated


# Rotations do not commute: the remainder of one round is of second order.
ROUNDS = 3


def without_free_motion(T_target_source: FloatArray, T_start: FloatArray, information: Information) -> FloatArray:
    """The pose without its motion from the initial pose along the free motions.

    The iterations drift along them: facets and far points seem to constrain the rotation of a round part.

    Parameters
    ----------
    T_target_source, T_start : ndarray, (4, 4)
        Pose and initial pose, in the frame whose origin is the centre of the information's twists.
    information : Information
        From `information_of`.

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
    scale = scaling_by(information.lever)
    T = T_target_source
    for _ in range(ROUNDS if free.shape[1] else 0):
        moved = twist.log(T @ pose.inverse(T_start)) * scale
        T = twist.exp(-free @ (free.T @ moved) / scale) @ T
    return T
