"""Matrices and Jacobians of quaternion products and of rotated vectors: Jia, *Quaternions* (2020), appendix D.

================== ======== ==================== ==============================================
function           equation derivative           matrix
================== ======== ==================== ==============================================
d_pq_d_p           35       p q by p             right_matrix(q)
d_pqc_d_p          36       p q* by p            right_matrix(q*)
d_pq_d_q           37       p q by q             left_matrix(p)
d_pqc_d_q          38       p q* by q            left_matrix(p) diag(1, -1, -1, -1)
d_qv_d_q           39       q v by q             right_matrix(v)
d_vq_d_q           40       v q by q             left_matrix(v)
d_vq_d_v           41       v q by v             right_matrix(q) without its first column
d_qv_d_v           42       q v by v             left_matrix(q) without its first column
d_rotate_d_v       43       q v q* by v          (q0^2 - |q|^2) I + 2 q q^T + 2 q0 [q x]
d_rotate_frame_d_v 44, 45   q* v q by v          (q0^2 - |q|^2) I + 2 q q^T - 2 q0 [q x]
d_rotate_d_q       46       q v q* by q          2 (q0 v + q x v, -v q^T + (v . q) I + q v^T - q0 [v x])
================== ======== ==================== ==============================================

p and q are quaternions (..., 4), scalar first, of any norm: all four numbers are free. v are vectors (..., 3). Rows are
components of the result, columns those of what it is differentiated by. All equations of the appendix agree with finite
differences as printed. On the unit sphere q moves by ``dq = (0, w) q / 2`` for a small rotation vector w in world
coordinates; the Jacobian by w is the Jacobian by q times ``right_matrix(q)[..., 1:] / 2``. Walker, Shao and Volz (1991)
write the scalar last: their matrices Q and W are ours with the first row and column moved to the end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.rigid._algebra import CONJUGATE, conjugate, cross_matrix
from dqreg.rigid._matrices import left_matrix, right_matrix
from dqreg.rigid._operands import as_quaternions, as_triples


def d_pq_d_p(q: ArrayLike) -> FloatArray:
    """Jacobian of p q by p (eq. 35).

    Parameters
    ----------
    q : array_like, (..., 4)
        The other factor.

    Returns
    -------
    ndarray, (..., 4, 4)

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

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
        The other factor.

    Returns
    -------
    ndarray, (..., 4, 4)

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

    Examples
    --------
    >>> p, q = np.array([3, 1, -2, 1]), [2, -1, 2, 3]
    >>> (d_pqc_d_p(q) @ p).tolist()  # linear in p, so that this is p q* itself
    [4.0, 13.0, -6.0, -7.0]
    """
    return right_matrix(conjugate(q))


def d_pq_d_q(p: ArrayLike) -> FloatArray:
    """Jacobian of p q by q (eq. 37).

    Parameters
    ----------
    p : array_like, (..., 4)
        The other factor.

    Returns
    -------
    ndarray, (..., 4, 4)

    Raises
    ------
    InputError
        If p does not hold four numbers in the last axis.

    Examples
    --------
    >>> (d_pq_d_q([3, 1, -2, 1]) @ [2, -1, 2, 3]).tolist()  # linear in q, so that this is p q itself
    [8.0, -9.0, -2.0, 11.0]
    """
    return left_matrix(p)


def d_pqc_d_q(p: ArrayLike) -> FloatArray:
    """Jacobian of p q* by q (eq. 38).

    Parameters
    ----------
    p : array_like, (..., 4)
        The other factor.

    Returns
    -------
    ndarray, (..., 4, 4)

    Raises
    ------
    InputError
        If p does not hold four numbers in the last axis.

    Examples
    --------
    >>> (d_pqc_d_q([3, 1, -2, 1]) @ [2, -1, 2, 3]).tolist()  # linear in q, so that this is p q* itself
    [4.0, 13.0, -6.0, -7.0]
    """
    return np.asarray(left_matrix(p) * CONJUGATE)


def d_qv_d_q(v: ArrayLike) -> FloatArray:
    """Jacobian of q v by q (eq. 39).

    Parameters
    ----------
    v : array_like, (..., 3)
        Vectors.

    Returns
    -------
    ndarray, (..., 4, 4)

    Raises
    ------
    InputError
        If v does not hold three numbers in the last axis.

    Examples
    --------
    >>> (d_qv_d_q([1, 0, 0]) @ [2, -1, 2, 3]).tolist()  # q times the pure quaternion of v
    [1.0, 2.0, 3.0, -2.0]
    """
    return right_matrix(pure(v))


def d_vq_d_q(v: ArrayLike) -> FloatArray:
    """Jacobian of v q by q (eq. 40).

    Parameters
    ----------
    v : array_like, (..., 3)
        Vectors.

    Returns
    -------
    ndarray, (..., 4, 4)

    Raises
    ------
    InputError
        If v does not hold three numbers in the last axis.

    Examples
    --------
    >>> (d_vq_d_q([1, 0, 0]) @ [2, -1, 2, 3]).tolist()  # the pure quaternion of v times q
    [1.0, 2.0, -3.0, 2.0]
    """
    return left_matrix(pure(v))


def d_vq_d_v(q: ArrayLike) -> FloatArray:
    """Jacobian of v q by v (eq. 41).

    Parameters
    ----------
    q : array_like, (..., 4)
        The other factor.

    Returns
    -------
    ndarray, (..., 4, 3)

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

    Examples
    --------
    >>> d_vq_d_v([2, -1, 2, 3])[1].tolist()
    [2.0, 3.0, -2.0]
    """
    return right_matrix(q)[..., 1:]


def d_qv_d_v(q: ArrayLike) -> FloatArray:
    """Jacobian of q v by v (eq. 42).

    Parameters
    ----------
    q : array_like, (..., 4)
        The other factor.

    Returns
    -------
    ndarray, (..., 4, 3)

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

    Examples
    --------
    >>> d_qv_d_v([2, -1, 2, 3])[1].tolist()
    [2.0, -3.0, 2.0]
    """
    return left_matrix(q)[..., 1:]


def d_rotate_d_q(q: ArrayLike, v: ArrayLike) -> FloatArray:
    """Jacobian of q v q* by q (eq. 46).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions.
    v : array_like, (..., 3)
        Vectors; leading axes broadcast against those of q.

    Returns
    -------
    ndarray, (..., 3, 4)

    Raises
    ------
    InputError
        If q does not hold four, or v three, numbers in the last axis.
    ValueError
        If leading axes do not broadcast.

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


def pure(v: ArrayLike, name: str = "v") -> FloatArray:
    """Quaternions without a scalar part. Shapes: v (..., 3), returns (..., 4)."""
    vectors = as_triples(v, name)
    return np.concatenate([np.zeros((*vectors.shape[:-1], 1)), vectors], axis=-1)
