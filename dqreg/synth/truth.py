"""Known motions and how far a pose is from the truth, both in lengths on the part itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg.arrays import FloatArray, as_float, as_pose, as_vectors
from dqreg.errors import InputError
from dqreg.rigid import pose


def disturbance(rng: np.random.Generator, angle_rad: float, offset: float, centre: ArrayLike) -> FloatArray:
    """Rigid motion of a known size about a point, in a random direction.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the axis of the turn and the direction of the shift, both uniform on the sphere.
    angle_rad : float
        Angle of the turn.
    offset : float
        Length of the shift of the centre.
    centre : array_like, (3,)
        Point about which the turn is made, usually the centre of the part.

    Returns
    -------
    ndarray, (4, 4)
        The motion; the centre moves by ``offset`` exactly.

    Raises
    ------
    InputError
        If the centre is not three numbers.

    Examples
    --------
    >>> T = disturbance(np.random.default_rng(0), 0.1, 2.0, [5.0, 0.0, 0.0])
    >>> float(np.linalg.norm(pose.apply(T, [5.0, 0.0, 0.0]) - [5.0, 0.0, 0.0]).round(12))
    2.0
    """
    axis, direction = _random_direction(rng), _random_direction(rng)
    turn = pose.exp(np.concatenate([angle_rad * axis, np.zeros(3)]))
    return pose.about(pose.from_parts(turn[:3, :3], offset * direction), _centre(centre))


def random_pose(rng: np.random.Generator, offset: float, centre: ArrayLike) -> FloatArray:
    """Rigid motion with a uniformly random turn about a point and a shift of known length.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the turn (uniform over all rotations) and the direction of the shift.
    offset : float
        Length of the shift of the centre.
    centre : array_like, (3,)
        Point about which the turn is made.

    Returns
    -------
    ndarray, (4, 4)
        The motion.

    Raises
    ------
    InputError
        If the centre is not three numbers.

    Examples
    --------
    >>> random_pose(np.random.default_rng(0), 2.0, [0.0, 0.0, 0.0]).shape
    (4, 4)
    """
    turn, direction = pose.random(rng), _random_direction(rng)
    return pose.about(pose.from_parts(turn[:3, :3], offset * direction), _centre(centre))


def worst_vertex_displacement(T: ArrayLike, T_truth: ArrayLike, vertices: ArrayLike) -> float:
    """Greatest distance between where a pose puts a vertex and where the true pose puts it.

    Parameters
    ----------
    T, T_truth : array_like, (4, 4)
        Pose to judge, and the true pose; both map the vertices' frame to the same other frame.
    vertices : array_like, (v, 3)
        Vertices of the part. For a pose ``T_target_source`` and vertices in the target frame give the inverse
        of both poses, or move the vertices first.

    Returns
    -------
    float
        A length in the unit of the vertices.

    Raises
    ------
    InputError
        If a pose is not rigid or there are no vertices.

    Examples
    --------
    >>> T = np.eye(4); T[:3, 3] = [0.0, 3.0, 4.0]
    >>> worst_vertex_displacement(T, np.eye(4), [[1.0, 2.0, 3.0]])
    5.0
    """
    return float(np.sqrt(_squared_displacements(T, T_truth, vertices).max()))


def rms_vertex_displacement(T: ArrayLike, T_truth: ArrayLike, vertices: ArrayLike) -> float:
    """Root mean square distance between where a pose puts the vertices and where the true pose puts them.

    Parameters
    ----------
    T, T_truth : array_like, (4, 4)
        Pose to judge, and the true pose, as for `worst_vertex_displacement`.
    vertices : array_like, (v, 3)
        Vertices of the part.

    Returns
    -------
    float
        A length in the unit of the vertices.

    Raises
    ------
    InputError
        If a pose is not rigid or there are no vertices.

    Examples
    --------
    >>> T = np.eye(4); T[:3, 3] = [0.0, 3.0, 4.0]
    >>> rms_vertex_displacement(T, np.eye(4), [[1.0, 2.0, 3.0]])
    5.0
    """
    return float(np.sqrt(_squared_displacements(T, T_truth, vertices).mean()))


def _squared_displacements(T: ArrayLike, T_truth: ArrayLike, vertices: ArrayLike) -> FloatArray:
    V = as_vectors(vertices, "vertices")
    if not len(V):
        raise InputError("vertices must hold at least one point")
    difference = as_pose(T, "T") - as_pose(T_truth, "T_truth")
    squares: FloatArray = ((V @ difference[:3, :3].T + difference[:3, 3]) ** 2).sum(axis=1)
    return squares


def _centre(value: ArrayLike) -> FloatArray:
    centre = as_float(value, "centre")
    if centre.shape != (3,):
        raise InputError(f"centre must be three numbers; got shape {centre.shape}")
    return centre


def _random_direction(rng: np.random.Generator) -> FloatArray:
    vector = rng.standard_normal(3)
    direction: FloatArray = vector / np.linalg.norm(vector)
    return direction
