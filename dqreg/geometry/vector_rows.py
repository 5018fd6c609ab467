"""Many vectors of three numbers, one a row: NumPy is slow along rows that short, and quick along columns."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, dot


def row_dots(left: FloatArray, right: FloatArray) -> FloatArray:
    """Scalar products of vectors, (n, 3) each: (n,). A third of the time of `np.einsum`."""
    terms = left * right
    found: FloatArray = terms[:, 0] + terms[:, 1]
    found += terms[:, 2]
    return found


def lengths_of(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors, (n, 3): (n,). A third of the time of `np.linalg.norm`."""
    lengths: FloatArray = np.sqrt(row_dots(vectors, vectors))
    return lengths


def nonzero_rows(vectors: FloatArray) -> BoolArray:
    """Which vectors, (n, 3), are not zero, (n,): ``vectors.any(axis=1)`` in a fifth of the time."""
    found: BoolArray = (vectors[:, 0] != 0.0) | (vectors[:, 1] != 0.0) | (vectors[:, 2] != 0.0)
    return found


def second_moment(columns: FloatArray) -> FloatArray:
    """Sums of the products of coordinates, (3, n). BLAS takes three times as long for ``columns @ columns.T``."""
    x, y, z = columns
    xx, xy, xz, yy, yz, zz = dot(x, x), dot(x, y), dot(x, z), dot(y, y), dot(y, z), dot(z, z)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Of two vectors, (3,): ``np.cross`` takes five times as long."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
