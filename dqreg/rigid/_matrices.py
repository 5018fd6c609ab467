"""The 3x3 matrix of a rotation from its quaternion, and back; the 4x4 matrices of a product.

Equation numbers: Jia, *Quaternions* (2020), section 3; Walker, Shao and Volz (1991), who write the scalar last.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.rigid._algebra import canonical, conjugate, cross_matrix
from dqreg.rigid._operands import as_quaternions, as_rotations, as_unit_quaternions

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


def to_matrix(q: ArrayLike) -> FloatArray:
    """Rotation matrix of a unit quaternion (Jia section 3, after eq. 8; Walker eqs. 4 and 17).

    Parameters
    ----------
    q : array_like, (..., 4)
        Unit quaternions, scalar first.

    Returns
    -------
    ndarray, (..., 3, 3)
        R with R v = q v q*: ``(q0^2 - |q|^2) I + 2 q q^T + 2 q0 [q x]``.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis, or is not of norm 1 to 1e-5.

    Examples
    --------
    >>> to_matrix([0.5, 0.5, 0.5, 0.5]).tolist()
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    """
    return operator_matrix(as_unit_quaternions(q, "q"))


def to_rotation(q: ArrayLike) -> Rotation:
    """Write unit quaternions as SciPy's class. Where a rotation is taken, here and in `from_matrix`, one will do.

    Parameters
    ----------
    q : array_like, (..., 4)
        Unit quaternions, scalar first.

    Returns
    -------
    scipy.spatial.transform.Rotation
        The same rotations.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis, or is not of norm 1 to 1e-5.

    Examples
    --------
    >>> to_rotation([0.5, 0.5, 0.5, 0.5]).as_rotvec(degrees=True).round(6).tolist()
    [69.282032, 69.282032, 69.282032]
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(np.roll(as_unit_quaternions(q, "q"), -1, axis=-1))  # SciPy puts the scalar last


def operator_matrix(q: ArrayLike) -> FloatArray:
    """Matrix of v -> q v q* for quaternions of any norm: |q|^2 times a rotation.

    Shapes: q (..., 4), returns (..., 3, 3).

    >>> operator_matrix([0, 0, 0, 2]).tolist()
    [[-4.0, 0.0, 0.0], [0.0, -4.0, 0.0], [0.0, 0.0, 4.0]]
    """
    array = as_quaternions(q, "q")
    if array.ndim == 1:
        scalar, vector = array[0], array[1:]
        square = np.sum(vector * vector)
        return np.asarray(
            (scalar**2 - square) * np.eye(3) + 2.0 * np.outer(vector, vector) + 2.0 * scalar * cross_matrix(vector)
        )
    # Column by column: many small products take four times as long.
    w, x, y, z = np.moveaxis(array, -1, 0)
    matrix = np.zeros((*array.shape[:-1], 3, 3))
    own = w * w - (x * x + y * y + z * z)
    for i, a in enumerate((x, y, z)):
        matrix[..., i, i] = own + 2.0 * (a * a)
    for i, j, a, b, c in ((0, 1, x, y, z), (1, 2, y, z, x), (2, 0, z, x, y)):
        mixed, turned = 2.0 * (a * b), 2.0 * (w * c)
        matrix[..., i, j], matrix[..., j, i] = mixed - turned, mixed + turned
    return matrix


def from_matrix(R: ArrayLike) -> FloatArray:
    """Find the unit quaternion of a rotation matrix (the way back of Jia section 3; Walker eqs. 21-24).

    Walker divides by r4 unless it is zero, which loses digits near half-turns. Here all four columns of
    ``4 q q^T`` are formed, and the one with the largest diagonal element, which is at least 1, is made a unit
    vector: eqs. 21-22 are its first column, eqs. 23-24 the other three at a half-turn.

    Parameters
    ----------
    R : array_like, (..., 3, 3)
        Rotation matrices.

    Returns
    -------
    ndarray, (..., 4)
        Unit quaternions, scalar first, in canonical sign (first non-zero component positive).

    Raises
    ------
    InputError
        If R is not (..., 3, 3), departs from orthonormal by more than 0.01, or holds a mirror image.

    Examples
    --------
    A half-turn about z:

    >>> from_matrix([[-1, 0, 0], [0, -1, 0], [0, 0, 1]]).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    return of_rotations(as_rotations(R, "R"))


def of_rotations(m: FloatArray) -> FloatArray:
    """`from_matrix` of what is known to be a rotation. Shapes: m (..., 3, 3), returns (..., 4)."""
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    columns = np.zeros((*m.shape[:-2], 4, 4))
    columns[..., 0, 0] = 1.0 + trace
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        columns[..., i + 1, i + 1] = 1.0 + 2.0 * m[..., i, i] - trace
        skew, mixed = m[..., k, j] - m[..., j, k], m[..., i, j] + m[..., j, i]
        columns[..., 0, i + 1] = columns[..., i + 1, 0] = skew
        columns[..., i + 1, j + 1] = columns[..., j + 1, i + 1] = mixed
    diagonal = np.diagonal(columns, axis1=-2, axis2=-1)
    largest = np.argmax(diagonal, axis=-1)
    column = columns.reshape(-1, 4, 4)[np.arange(largest.size), largest.ravel()].reshape(*largest.shape, 4)
    return canonical(column / np.linalg.norm(column, axis=-1, keepdims=True))


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

    Raises
    ------
    InputError
        If p does not hold four numbers in the last axis.

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

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

    Examples
    --------
    >>> (right_matrix([2, -1, 2, 3]) @ [3, 1, -2, 1]).tolist()
    [8.0, -9.0, -2.0, 11.0]
    """
    return _product_matrix(as_quaternions(q, "q"), -1.0)


def d_rotate_d_v(q: ArrayLike) -> FloatArray:
    """Jacobian of q v q* by v (eq. 43): the rotation matrix where q is of norm 1.

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions.

    Returns
    -------
    ndarray, (..., 3, 3)

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

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

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

    Examples
    --------
    The transpose of `d_rotate_d_v`:

    >>> d_rotate_frame_d_v([0.5, 0.5, 0.5, 0.5]).tolist()
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    return d_rotate_d_v(conjugate(q))


def _product_matrix(q: FloatArray, side: float) -> FloatArray:
    scalar, vector = q[..., 0], q[..., 1:]
    matrix = np.zeros((*q.shape, 4))
    matrix[..., 0, 0] = scalar
    matrix[..., 0, 1:] = -vector
    matrix[..., 1:, 0] = vector
    matrix[..., 1:, 1:] = scalar[..., np.newaxis, np.newaxis] * np.eye(3) + side * cross_matrix(vector)
    return matrix
