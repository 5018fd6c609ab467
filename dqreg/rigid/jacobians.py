"""Jacobians of quaternion products: Jia, *Quaternions* (2020), appendix D, eqs. 35-42.

A quaternion is a column of four numbers, scalar first, all of them free. ``d_pq_d_p`` is the matrix of
derivatives of p q by p; a ``c`` after a letter stands for the conjugate (``pqc`` is p q*), and v is a vector.
Every equation of the appendix agrees with finite differences as printed.

Jacobians of rotated vectors: Jia, *Quaternions* (2020), appendix D, eqs. 43-46.

The four components of q are free. On the unit sphere q moves by ``dq = (0, w) q / 2`` for a small rotation vector w
in world coordinates; the Jacobian by w is the Jacobian by q times ``right_matrix(q)[..., 1:] / 2``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.rigid.operands import as_quaternions, as_triples
from dqreg.rigid.quaternion_algebra import conjugate, cross_matrix
from dqreg.rigid.quaternion_matrices import left_matrix, operator_matrix, right_matrix

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def d_pq_d_p(q: ArrayLike) -> FloatArray:
    """Jacobian of p q by p (eq. 35).

    Parameters
    ----------
    q : array_like, (..., 4)
        The other factor, scalar first.

    Returns
    -------
    ndarray, (..., 4, 4)
        Rows: components of the product; columns: components of what it is differentiated by.

    Raises
    ------
    InputError
        If the last axis does not hold four numbers.

    Examples
    --------
    >>> d_pq_d_p([2, -1, 2, 3])[0].tolist()
    [2.0, 1.0, -2.0, -3.0]
    """
    return right_matrix(q)


def d_pqc_d_p(q: ArrayLike) -> FloatArray:
    """Jacobian of p q* by p (eq. 36).

    Parameters
    ----------
    q : array_like, (..., 4)
        The other factor, scalar first.

    Returns
    -------
    ndarray, (..., 4, 4)
        Rows: components of the product; columns: components of what it is differentiated by.

    Raises
    ------
    InputError
        If the last axis does not hold four numbers.

    Examples
    --------
    >>> d_pqc_d_p([2, -1, 2, 3])[0].tolist()
    [2.0, -1.0, 2.0, 3.0]
    """
    return right_matrix(conjugate(q))


def d_pq_d_q(p: ArrayLike) -> FloatArray:
    """Jacobian of p q by q (eq. 37).

    Parameters
    ----------
    p : array_like, (..., 4)
        The other factor, scalar first.

    Returns
    -------
    ndarray, (..., 4, 4)
        Rows: components of the product; columns: components of what it is differentiated by.

    Raises
    ------
    InputError
        If the last axis does not hold four numbers.

    Examples
    --------
    >>> d_pq_d_q([3, 1, -2, 1])[0].tolist()
    [3.0, -1.0, 2.0, -1.0]
    """
    return left_matrix(p)


def d_pqc_d_q(p: ArrayLike) -> FloatArray:
    """Jacobian of p q* by q (eq. 38).

    Parameters
    ----------
    p : array_like, (..., 4)
        The other factor, scalar first.

    Returns
    -------
    ndarray, (..., 4, 4)
        Rows: components of the product; columns: components of what it is differentiated by.

    Raises
    ------
    InputError
        If the last axis does not hold four numbers.

    Examples
    --------
    >>> d_pqc_d_q([3, 1, -2, 1])[0].tolist()
    [3.0, 1.0, -2.0, 1.0]
    """
    return np.asarray(left_matrix(p) * _CONJUGATE)


def d_qv_d_q(v: ArrayLike) -> FloatArray:
    """Jacobian of q v by q (eq. 39).

    Parameters
    ----------
    v : array_like, (..., 3)
        Vectors.

    Returns
    -------
    ndarray, (..., 4, 4)
        Rows: components of the product; columns: components of what it is differentiated by.

    Raises
    ------
    InputError
        If the last axis does not hold three numbers.

    Examples
    --------
    >>> d_qv_d_q([1, 2, 3])[0].tolist()
    [0.0, -1.0, -2.0, -3.0]
    """
    return right_matrix(_pure(v))


def d_vq_d_q(v: ArrayLike) -> FloatArray:
    """Jacobian of v q by q (eq. 40).

    Parameters
    ----------
    v : array_like, (..., 3)
        Vectors.

    Returns
    -------
    ndarray, (..., 4, 4)
        Rows: components of the product; columns: components of what it is differentiated by.

    Raises
    ------
    InputError
        If the last axis does not hold three numbers.

    Examples
    --------
    >>> d_vq_d_q([1, 2, 3])[1].tolist()
    [1.0, 0.0, -3.0, 2.0]
    """
    return left_matrix(_pure(v))


def d_vq_d_v(q: ArrayLike) -> FloatArray:
    """Jacobian of v q by v (eq. 41).

    Parameters
    ----------
    q : array_like, (..., 4)
        The quaternion, scalar first.

    Returns
    -------
    ndarray, (..., 4, 3)
        Rows: components of the product; columns: components of what it is differentiated by.

    Raises
    ------
    InputError
        If the last axis does not hold four numbers.

    Examples
    --------
    >>> d_vq_d_v([2, -1, 2, 3]).shape
    (4, 3)
    """
    return right_matrix(q)[..., 1:]


def d_qv_d_v(q: ArrayLike) -> FloatArray:
    """Jacobian of q v by v (eq. 42).

    Parameters
    ----------
    q : array_like, (..., 4)
        The quaternion, scalar first.

    Returns
    -------
    ndarray, (..., 4, 3)
        Rows: components of the product; columns: components of what it is differentiated by.

    Raises
    ------
    InputError
        If the last axis does not hold four numbers.

    Examples
    --------
    >>> d_qv_d_v([2, -1, 2, 3]).shape
    (4, 3)
    """
    return left_matrix(q)[..., 1:]


def _pure(v: ArrayLike) -> FloatArray:
    vectors = as_triples(v, "v")
    return np.concatenate([np.zeros((*vectors.shape[:-1], 1)), vectors], axis=-1)


def d_rotate_d_v(q: ArrayLike) -> FloatArray:
    """Jacobian of q v q* by v (eq. 43); the rotation matrix where q is of norm 1.

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions of any norm, scalar first.

    Returns
    -------
    ndarray, (..., 3, 3)
        ``(q0^2 - |q|^2) I + 2 q q^T + 2 q0 [q x]``.

    Raises
    ------
    InputError
        If the last axis does not hold four numbers.

    Examples
    --------
    >>> d_rotate_d_v([0.5, 0.5, 0.5, 0.5]).tolist()
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    """
    return operator_matrix(q)


def d_rotate_frame_d_v(q: ArrayLike) -> FloatArray:
    """Jacobian of q* v q by v (eqs. 44-45).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions of any norm, scalar first.

    Returns
    -------
    ndarray, (..., 3, 3)
        ``(q0^2 - |q|^2) I + 2 q q^T - 2 q0 [q x]``.

    Raises
    ------
    InputError
        If the last axis does not hold four numbers.

    Examples
    --------
    >>> d_rotate_frame_d_v([0.5, 0.5, 0.5, 0.5]).tolist()
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    return d_rotate_d_v(conjugate(q))


def d_rotate_d_q(q: ArrayLike, v: ArrayLike) -> FloatArray:
    """Jacobian of q v q* by q (eq. 46).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions, scalar first.
    v : array_like, (..., 3)
        Vectors; leading axes broadcast against those of q.

    Returns
    -------
    ndarray, (..., 3, 4)
        ``2 (q0 v + q x v, -v q^T + (v . q) I + q v^T - q0 [v x])``.

    Raises
    ------
    InputError
        If a shape is wrong.

    Examples
    --------
    >>> d_rotate_d_q([1, 0, 0, 0], [1, 0, 0]).tolist()
    [[2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 2.0], [0.0, 0.0, -2.0, 0.0]]
    """
    array, vectors = as_quaternions(q, "q"), as_triples(v, "v")
    scalar, axial = array[..., :1], array[..., 1:]
    by_scalar = scalar * vectors + np.cross(axial, vectors)
    along = np.sum(vectors * axial, axis=-1)[..., np.newaxis, np.newaxis]
    outer = axial[..., :, np.newaxis] * vectors[..., np.newaxis, :]
    by_vector = along * np.eye(3) + outer - np.swapaxes(outer, -1, -2) - scalar[..., np.newaxis] * cross_matrix(vectors)
    return np.asarray(2.0 * np.concatenate([by_scalar[..., np.newaxis], by_vector], axis=-1))
