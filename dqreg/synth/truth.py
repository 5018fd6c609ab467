"""Known motions and how far a pose is from the truth, both in lengths on the part itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_pose, as_vectors
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
    return float(np.sqrt(_squared_displacements(T, T_truth, vertices).max()))


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
    return float(np.sqrt(_squared_displacements(T, T_truth, vertices).mean()))


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
        A point on the axis of a round part and the axis's direction, in the part's frame: any turn about it, after
        one of the poses, is true as well. The turn with the least mean square displacement is taken.

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
    V, judged = as_vectors(vertices, "vertices"), as_pose(T, "T")
    candidates = [as_pose(truth, "truths") for truth in np.asarray(truths, dtype=np.float64)]
    if not candidates:
        raise InputError("truths must hold at least one pose")
    if axis is not None:
        candidates = [_turned_nearest(judged, truth, V, *axis) for truth in candidates]
    worst = [worst_vertex_displacement(judged, truth, V) for truth in candidates]
    best = int(np.argmin(worst))
    return candidates[best], worst[best]


def _turned_nearest(T: FloatArray, truth: FloatArray, V: FloatArray, point: ArrayLike, way: ArrayLike) -> FloatArray:
    """Turn a true pose about the part's axis until it is as near to T as it can be.

    A vertex b of a round part and its turned twin Q b are alike, so the sum of |D b - Q b|^2 is to be least, with
    D from the true pose to T: the angle of Q is that between the parts of b and D b across the axis.
    """
    origin, k = _centre(point), np.asarray(way, dtype=np.float64)
    k = k / np.linalg.norm(k)
    b, moved = V - origin, pose.apply(T @ pose.inverse(truth), V) - origin
    across = b - (b @ k)[:, None] * k
    angle_rad = np.arctan2((np.cross(across, moved) @ k).sum(), np.einsum("vi,vi->", across, moved))
    return pose.about(pose.exp(np.concatenate([angle_rad * k, np.zeros(3)])), origin) @ truth


def _squared_displacements(T: ArrayLike, T_truth: ArrayLike, vertices: ArrayLike) -> FloatArray:
    V = as_vectors(vertices, "vertices")
    if not len(V):
        raise InputError("vertices must hold at least one point")
    # The difference first: what is left of two nearly equal poses is small, and keeps its digits.
    difference = as_pose(T, "T") - as_pose(T_truth, "T_truth")
    difference = difference @ pose.inverse(T_truth)
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
