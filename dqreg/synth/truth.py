"""Known motions and how far a pose is from the truth, both in lengths on the part itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_pose, as_vectors, pose_of
from dqreg.errors import InputError
from dqreg.rigid import pose


def disturbance(rng: np.random.Generator, angle_rad: float, offset: float, centre: ArrayLike) -> FloatArray:
    """Rigid motion of a known size about a point, in a random direction.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the axis of the rotation and the direction of the translation, both uniform on the sphere.
    angle_rad : float
        Angle of the rotation.
    offset : float
        Length of the translation of the centre.
    centre : array_like, (3,)
        Point about which the rotation is made, usually the centre of the part.

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
    """Rigid motion with a uniformly random rotation about a point and a translation of known length.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the rotation (uniform over all) and the direction of the translation.
    offset : float
        Length of the translation of the centre.
    centre : array_like, (3,)
        Point about which the rotation is made.

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
    """Greatest distance of a vertex of the part from where the true pose has it.

    The scan of a vertex b lies at inv(T_truth) b; a pose puts it at T inv(T_truth) b, which should be b.

    Parameters
    ----------
    T, T_truth : array_like, (4, 4)
        ``T_target_source``: pose to judge, and the true pose.
    vertices : array_like, (v, 3)
        Vertices of the part, in its own (target) frame.

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
    return float(_checked_displacements(T, T_truth, vertices).max())


def rms_vertex_displacement(T: ArrayLike, T_truth: ArrayLike, vertices: ArrayLike) -> float:
    """Root mean square distance of the part's vertices from where the true pose has them.

    Parameters
    ----------
    T, T_truth : array_like, (4, 4)
        ``T_target_source``: pose to judge, and the true pose, as for `worst_vertex_displacement`.
    vertices : array_like, (v, 3)
        Vertices of the part, in its own (target) frame.

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
    return float(np.sqrt((_checked_displacements(T, T_truth, vertices) ** 2).mean()))


def nearest_truth(
    T: ArrayLike, truths: ArrayLike, vertices: ArrayLike, axis: tuple[ArrayLike, ArrayLike] | None = None
) -> tuple[FloatArray, float]:
    """Of several true poses the one that is nearest to a pose, and how far off the pose is from it.

    Parameters
    ----------
    T : array_like, (4, 4)
        T_target_source, the pose to judge.
    truths : array_like, (k, 4, 4)
        Poses of the same kind, all of them true: ``symmetric_truths`` of a case.
    vertices : array_like, (v, 3)
        Vertices of the part, in its own (target) frame.
    axis : (array_like (3,), array_like (3,)), optional
        A point on the axis of a round part and the axis's direction, in the part's frame: any rotation about it, after
        one of the poses, is true as well. The rotation with the least mean square displacement is taken.

    Returns
    -------
    T_truth : ndarray, (4, 4)
        The nearest true pose.
    worst : float
        Greatest distance between where the two put a vertex, in the unit of the vertices.

    Raises
    ------
    InputError
        If a pose is not rigid, or there are no poses or vertices.

    Examples
    --------
    >>> half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    >>> nearest_truth(half_turn, [np.eye(4), half_turn], [[1.0, 2.0, 3.0]])[1]
    0.0
    """
    V, judged = _points(vertices), as_pose(T, "T")
    candidates = [as_pose(truth, "truths") for truth in pose_of(truths)]
    if not candidates:
        raise InputError("truths must hold at least one pose")
    line = None if axis is None else np.stack([_centre(axis[0]), as_float(axis[1], "axis")])
    nearest = closest_truth(judged, np.stack(candidates), V, line)
    return nearest, worst_vertex_displacement(judged, nearest, V)


def closest_truth(T: FloatArray, truths: FloatArray, points_target: FloatArray, axis: FloatArray | None) -> FloatArray:
    """Nearest true pose to any 4x4 matrix by its worst displacement; unchecked.

    Shapes: truths (k, 4, 4), axis (2, 3) point and direction of an axis of revolution.
    """
    candidates = [truth if axis is None else _rotated(truth, T, points_target, axis) for truth in truths]
    worst = [displacements(T, truth, points_target).max() for truth in candidates]
    return candidates[int(np.argmin(worst))]


def displacements(T: FloatArray, T_truth: FloatArray, points_target: FloatArray) -> FloatArray:
    """Distance of each point of the part from where a pose puts it; unchecked.

    The difference of the poses first: of two that are nearly equal it is small, and keeps its digits.
    """
    points_source = pose.apply(pose.inverse(T_truth), points_target)
    difference = T - T_truth
    moved: FloatArray = np.linalg.norm(points_source @ difference[:3, :3].T + difference[:3, 3], axis=1)
    return moved


def _rotated(truth: FloatArray, T: FloatArray, points_target: FloatArray, axis: FloatArray) -> FloatArray:
    """The true pose rotated about the axis of revolution to the least mean square displacement (2-D Procrustes)."""
    point, direction = axis
    direction = direction / np.linalg.norm(direction)
    true = points_target - point
    found = pose.apply(pose.inverse(truth), points_target) @ T[:3, :3].T + T[:3, 3] - point
    sine = (np.cross(true, found) @ direction).sum()
    cosine = (true * found).sum() - ((true @ direction) * (found @ direction)).sum()
    rotation = pose.exp(np.concatenate([np.arctan2(sine, cosine) * direction, np.zeros(3)]))
    best: FloatArray = pose.about(rotation, point) @ truth
    return best


def _checked_displacements(T: ArrayLike, T_truth: ArrayLike, vertices: ArrayLike) -> FloatArray:
    return displacements(as_pose(T, "T"), as_pose(T_truth, "T_truth"), _points(vertices))


def _points(vertices: ArrayLike) -> FloatArray:
    V = as_vectors(vertices, "vertices")
    if not len(V):
        raise InputError("vertices must hold at least one point")
    return V


def _centre(value: ArrayLike) -> FloatArray:
    centre = as_float(value, "centre")
    if centre.shape != (3,):
        raise InputError(f"centre must be three numbers; got shape {centre.shape}")
    return centre


def _random_direction(rng: np.random.Generator) -> FloatArray:
    vector = rng.standard_normal(3)
    direction: FloatArray = vector / np.linalg.norm(vector)
    return direction
