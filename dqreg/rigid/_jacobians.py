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
from dqreg.rigid._matrices import operator_matrix
from dqreg.rigid._operands import as_quaternions, as_triples


def left_matrix(p: ArrayLike) -> FloatArray:
    """Matrix of a product from the left: ``left_matrix(p) @ q`` is p q (Jia eq. 37; Walker eq. 15: Q).

    Parameters
    ----------
    p : array_like, (..., 4)
        Quaternions, scalar first.

    Returns
    -------
    ndarray, (..., 4, 4)
        Rows and columns in the order w, x, y, z.

    Examples
    --------
    >>> (left_matrix([3, 1, -2, 1]) @ [2, -1, 2, 3]).tolist()
    [8.0, -9.0, -2.0, 11.0]
    """
    return _product_matrix(as_quaternions(p, "p"), 1.0)


def right_matrix(q: ArrayLike) -> FloatArray:
    """Matrix of a product from the right: ``right_matrix(q) @ p`` is p q (Jia eq. 35; Walker eq. 16: W).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions, scalar first.

    Returns
    -------
    ndarray, (..., 4, 4)
        Rows and columns in the order w, x, y, z.

    Examples
    --------
    >>> (right_matrix([2, -1, 2, 3]) @ [3, 1, -2, 1]).tolist()
    [8.0, -9.0, -2.0, 11.0]
    """
    return _product_matrix(as_quaternions(q, "q"), -1.0)


def d_pq_d_p(q: ArrayLike) -> FloatArray:
    """Jacobian of p q by p (eq. 35).

    Parameters
    ----------
    q : array_like, (..., 4)
        The other factor.

    Returns
    -------
    ndarray, (..., 4, 4)

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
    """
    return left_matrix(_pure(v))


def d_vq_d_v(q: ArrayLike) -> FloatArray:
    """Jacobian of v q by v (eq. 41).

    Parameters
    ----------
    q : array_like, (..., 4)
        The other factor.

    Returns
    -------
    ndarray, (..., 4, 3)
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

    Examples
    --------
    >>> d_qv_d_v([2, -1, 2, 3])[1].tolist()
    [2.0, -3.0, 2.0]
    """
    return left_matrix(q)[..., 1:]


def d_rotate_d_v(q: ArrayLike) -> FloatArray:
    """Jacobian of q v q* by v (eq. 43): the rotation matrix where q is of norm 1.

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions.

    Returns
    -------
    ndarray, (..., 3, 3)

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
        Quaternions.

    Returns
    -------
    ndarray, (..., 3, 3)
    """
    return d_rotate_d_v(conjugate(q))


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


def _product_matrix(q: FloatArray, side: float) -> FloatArray:
    scalar, vector = q[..., 0], q[..., 1:]
    matrix = np.zeros((*q.shape, 4))
    matrix[..., 0, 0] = scalar
    matrix[..., 0, 1:] = -vector
    matrix[..., 1:, 0] = vector
    matrix[..., 1:, 1:] = scalar[..., np.newaxis, np.newaxis] * np.eye(3) + side * cross_matrix(vector)
    return matrix


def _pure(v: ArrayLike) -> FloatArray:
    vectors = as_triples(v, "v")
    return np.concatenate([np.zeros((*vectors.shape[:-1], 1)), vectors], axis=-1)
