"""Quaternion algebra on arrays (..., 4), scalar first: sum, product, conjugate, norm, inverse, matrices.

Equation numbers are those of Jia, *Quaternions* (notes, 2020), section 2. Leading axes broadcast. A number
that is not finite passes through to the result.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.rigid._operands import as_quaternions, as_triples

CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def add(p: ArrayLike, q: ArrayLike) -> FloatArray:
    """Sum of two quaternions, component by component (section 2.1, after eq. 2).

    Parameters
    ----------
    p, q : array_like, (..., 4)
        Summands.

    Returns
    -------
    ndarray, (..., 4)
        p + q.

    Raises
    ------
    InputError
        If p or q does not hold four numbers in the last axis.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> add([3, 1, -2, 1], [2, -1, 2, 3]).tolist()
    [5.0, 0.0, 0.0, 4.0]
    """
    return np.asarray(as_quaternions(p, "p") + as_quaternions(q, "q"))


def multiply(p: ArrayLike, q: ArrayLike) -> FloatArray:
    """Hamilton product p q (eq. 3).

    Parameters
    ----------
    p, q : array_like, (..., 4)
        Factors; as rotations, q acts first.

    Returns
    -------
    ndarray, (..., 4)
        Scalar part ``p0 q0 - p . q``, vector part ``p0 q + q0 p + p x q``.

    Raises
    ------
    InputError
        If p or q does not hold four numbers in the last axis.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    The notes' example 1:

    >>> multiply([3, 1, -2, 1], [2, -1, 2, 3]).tolist()
    [8.0, -9.0, -2.0, 11.0]
    """
    p, q = as_quaternions(p, "p"), as_quaternions(q, "q")
    p0, p1, p2, p3 = (p[..., k] for k in range(4))
    q0, q1, q2, q3 = (q[..., k] for k in range(4))
    scalar = p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3
    # Filled component by component: moved axes and a stack take most of the time of few quaternions.
    product = np.zeros((*scalar.shape, 4))
    product[..., 0] = scalar
    product[..., 1] = p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2
    product[..., 2] = p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1
    product[..., 3] = p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0
    return product


def conjugate(q: ArrayLike) -> FloatArray:
    """Conjugate q* = q0 - **q** (section 2.2); reverses a product, (pq)* = q* p* (eq. 4).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions.

    Returns
    -------
    ndarray, (..., 4)
        q*.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

    Examples
    --------
    >>> conjugate([2, -1, 2, 3]).tolist()
    [2.0, 1.0, -2.0, -3.0]
    """
    return np.asarray(as_quaternions(q, "q") * CONJUGATE)


def norm(q: ArrayLike) -> FloatArray:
    """Norm |q| = sqrt(q* q) (section 2.2).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions.

    Returns
    -------
    ndarray, (...)
        Norms; a single number for a single quaternion.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

    Examples
    --------
    >>> float(norm([1, 1, 1, 1]))
    2.0
    """
    return np.asarray(np.linalg.norm(as_quaternions(q, "q"), axis=-1))


def inverse(q: ArrayLike) -> FloatArray:
    """Inverse q* / |q|^2 (section 2.2).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions other than zero.

    Returns
    -------
    ndarray, (..., 4)
        The quaternion whose product with q, on either side, is 1.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis, or is zero.

    Examples
    --------
    >>> inverse([0, 2, 0, 0]).tolist()
    [0.0, -0.5, -0.0, -0.0]
    """
    length = _positive_norm(q)
    return np.asarray(conjugate(q) / length / length)


def normalize(q: ArrayLike) -> FloatArray:
    """Scale to norm 1: q / |q| (appendix B, after Euler's step).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions other than zero.

    Returns
    -------
    ndarray, (..., 4)
        Quaternions of norm 1.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis, or is zero.

    Examples
    --------
    >>> normalize([0, 0, 3, 4]).tolist()
    [0.0, 0.0, 0.6, 0.8]
    """
    return np.asarray(as_quaternions(q, "q") / _positive_norm(q))


def canonical(q: ArrayLike) -> FloatArray:
    """Of q and -q, the same rotation, the one whose first non-zero component is positive.

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions.

    Returns
    -------
    ndarray, (..., 4)
        q or -q.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

    Examples
    --------
    >>> canonical([0, -0.6, 0, 0.8]).tolist()
    [0.0, 0.6, 0.0, -0.8]
    """
    array = as_quaternions(q, "q")
    # Adding zero makes 0.0 of the -0.0 of a flipped zero.
    return np.asarray(canonical_sign(array)[..., np.newaxis] * array + 0.0)


def canonical_sign(q: ArrayLike) -> FloatArray:
    """Sign that leads to the canonical form.

    Shapes: q (..., 4).

    >>> float(canonical_sign([0, -0.6, 0, 0.8]))
    -1.0
    """
    array = as_quaternions(q, "q")
    below, other = array < 0.0, array != 0.0
    flipped = below[..., 3]
    for k in (2, 1, 0):
        flipped = np.where(other[..., k], below[..., k], flipped)
    return np.where(flipped, -1.0, 1.0)


def cross_matrix(u: ArrayLike) -> FloatArray:
    """Skew matrix [u x] with [u x] v = u x v (section 3; appendix D; Walker eq. 5: K).

    It is the Jacobian of u x v by v; the one by u is ``-cross_matrix(v)``.

    Parameters
    ----------
    u : array_like, (..., 3)
        Vectors.

    Returns
    -------
    ndarray, (..., 3, 3)
        Skew-symmetric matrices.

    Raises
    ------
    InputError
        If u does not hold three numbers in the last axis.

    Examples
    --------
    >>> (cross_matrix([1, 2, 3]) @ [1, 0, 0]).tolist()
    [0.0, 3.0, -2.0]
    """
    vectors = as_triples(u, "u")
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    matrix = np.zeros((*vectors.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix


def _positive_norm(q: ArrayLike) -> FloatArray:
    length = norm(q)
    if np.any(length == 0.0):
        raise InputError("q must not be zero: a zero quaternion has no direction and no inverse")
    return length[..., np.newaxis]
