"""What a pose, or a stack of poses, does to points, directions, lines and planes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, product
from dqreg.rigid import single_pose
from dqreg.rigid._operands import as_lines, as_planes, as_poses, as_triples, require_meeting


def apply(T_target_source: ArrayLike, points_source: ArrayLike) -> FloatArray:
    """Move points by poses: ``R p + t``.

    Parameters
    ----------
    T_target_source : array_like, (..., 4, 4)
        Rigid poses.
    points_source : array_like, (..., 3)
        Points, usually (n, 3). One pose moves them all. The axes of a stack broadcast against the leading axes of the
        points: n poses move n points one by one, and ``poses[:, None]`` moves all points by each.

    Returns
    -------
    ndarray, (..., 3)
        Points in the target frame, float64.

    Raises
    ------
    InputError
        If the poses are not (..., 4, 4) or (..., 3, 4), the points not (..., 3), or their leading axes do not
        broadcast.

    Examples
    --------
    >>> T = np.eye(4)
    >>> T[:3, 3] = 1, 2, 3
    >>> apply(T, [[10, 20, 30]]).tolist()
    [[11.0, 22.0, 33.0]]
    """
    T = as_poses(T_target_source, "T_target_source")
    points = as_triples(points_source, "points_source")
    if T.ndim > 2:
        require_meeting(poses=T.shape[:-2], points=points.shape[:-1])
        return _times(T, points) + T[..., :3, 3]
    return single_pose.apply(T, points)


def rotate(T_target_source: ArrayLike, directions_source: ArrayLike) -> FloatArray:
    """Rotate directions by poses: ``R m``, without the translation.

    Parameters
    ----------
    T_target_source : array_like, (..., 4, 4)
        Rigid poses.
    directions_source : array_like, (..., 3)
        Directions, usually (n, 3); they broadcast as points do in `apply`.

    Returns
    -------
    ndarray, (..., 3)
        Directions in the target frame, float64.

    Raises
    ------
    InputError
        If the poses are not (..., 4, 4) or (..., 3, 4), the directions not (..., 3), or their leading axes do not
        broadcast.

    Examples
    --------
    >>> T = np.eye(4)
    >>> T[:3, 3] = 1, 2, 3
    >>> rotate(T, [[0, 0, 1]]).tolist()
    [[0.0, 0.0, 1.0]]
    """
    T = as_poses(T_target_source, "T_target_source")
    directions = as_triples(directions_source, "directions_source")
    if T.ndim > 2:
        require_meeting(poses=T.shape[:-2], directions=directions.shape[:-1])
        return _times(T, directions)
    turn = np.ascontiguousarray(T[:3, :3].T)
    turned: FloatArray = product(directions, turn) if directions.ndim == 2 else directions @ turn
    return turned


def move_lines(T_target_source: ArrayLike, lines_source: ArrayLike) -> FloatArray:
    """Move lines, as `dqreg.rigid.lines` writes them: ``R n + eps (R m + t x R n)`` (Walker eqs. 9 and 60).

    Parameters
    ----------
    T_target_source : array_like, (..., 4, 4)
        Rigid poses.
    lines_source : array_like, (..., 6)
        Direction n and moment m of each line; they broadcast as points do in `apply`.

    Returns
    -------
    ndarray, (..., 6)
        Lines in the target frame.

    Raises
    ------
    InputError
        If the poses are not (..., 4, 4) or (..., 3, 4), the lines not (..., 6), or their leading axes do not broadcast.

    Examples
    --------
    >>> T = np.eye(4)
    >>> T[:3, 3] = 1, 2, 3
    >>> move_lines(T, [0, 0, 1, 0, 0, 0]).tolist()
    [0.0, 0.0, 1.0, 2.0, -1.0, 0.0]
    """
    T, lines = as_poses(T_target_source, "T_target_source"), as_lines(lines_source, "lines_source")
    return shifted_lines(rotate(T, lines[..., :3]), rotate(T, lines[..., 3:]), T[..., :3, 3])


def move_planes(T_target_source: ArrayLike, planes_source: ArrayLike) -> FloatArray:
    """Move planes ``a x + b y + c z + d = 0``.

    Parameters
    ----------
    T_target_source : array_like, (..., 4, 4)
        Rigid poses.
    planes_source : array_like, (..., 4)
        Coefficients a, b, c, d of each plane; they broadcast as points do in `apply`.

    Returns
    -------
    ndarray, (..., 4)
        Planes in the target frame, with normals of the same length.

    Raises
    ------
    InputError
        If the poses are not (..., 4, 4) or (..., 3, 4), the planes not (..., 4), or their leading axes do not
        broadcast.

    Examples
    --------
    >>> T = np.eye(4)
    >>> T[:3, 3] = 1, 2, 3
    >>> move_planes(T, [0, 0, 1, -10]).tolist()
    [0.0, 0.0, 1.0, -13.0]
    """
    T, planes = as_poses(T_target_source, "T_target_source"), as_planes(planes_source, "planes_source")
    return shifted_planes(rotate(T, planes[..., :3]), planes[..., 3:], T[..., :3, 3])


def shifted_lines(direction: FloatArray, moment: FloatArray, t: FloatArray) -> FloatArray:
    """Lines (..., 6) of rotated directions and moments, moved by t; (..., 3) each."""
    both = np.broadcast_arrays(direction, moment + np.cross(t, direction))
    return np.concatenate(both, axis=-1)


def shifted_planes(normal: FloatArray, offset: FloatArray, t: FloatArray) -> FloatArray:
    """Planes (..., 4) of rotated normals (..., 3) and offsets (..., 1), moved by t, (..., 3)."""
    moved = offset - np.sum(normal * t, axis=-1, keepdims=True)
    return np.concatenate([np.broadcast_to(normal, (*moved.shape[:-1], 3)), moved], axis=-1)


def _times(T: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...ij,...j->...i", T[..., :3, :3], vectors))
