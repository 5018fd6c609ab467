"""The 3x3 matrix of a rotation from its quaternion, and back.

Equation numbers: Jia, *Quaternions* (2020), section 3; Walker, Shao and Volz (1991), who write the scalar last.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.rigid._algebra import canonical, cross_matrix
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
    largest = np.argmax(diagonal, axis=-1)[..., np.newaxis, np.newaxis]
    column = np.take_along_axis(columns, largest, axis=-2)[..., 0, :]
    return canonical(column / np.linalg.norm(column, axis=-1, keepdims=True))
