"""Matrices of section 5 of Y.-B. Jia, *Quaternions* (2020), by their own letters; `dqreg.solvers.horn` uses them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_vectors, as_weights

__all__ = ["M", "P", "Q"]


def P(p: ArrayLike) -> FloatArray:
    """Matrices P_i with ``P_i q = q p_i`` (Jia section 5, after eq. 17).

    Parameters
    ----------
    p : array_like, (n, 3)
        Vectors p_i.

    Returns
    -------
    ndarray, (n, 4, 4)
        Matrices for quaternions w, x, y, z.

    Raises
    ------
    InputError
        If the vectors are not (n, 3), or not finite.

    Examples
    --------
    >>> (P([[1, 0, 0]])[0] @ [0, 0, 1, 0]).tolist()
    [0.0, 0.0, 0.0, -1.0]
    """
    p1, p2, p3 = as_vectors(p, "p").T
    o = np.zeros(len(p1))
    rows = [[o, -p1, -p2, -p3], [p1, o, p3, -p2], [p2, -p3, o, p1], [p3, p2, -p1, o]]
    return np.moveaxis(np.array(rows), 2, 0)


def Q(q: ArrayLike) -> FloatArray:
    """Matrices Q_i with ``Q_i q = q_i q`` (Jia section 5, after eq. 17).

    Parameters
    ----------
    q : array_like, (n, 3)
        Vectors q_i.

    Returns
    -------
    ndarray, (n, 4, 4)
        Matrices for quaternions w, x, y, z.

    Raises
    ------
    InputError
        If the vectors are not (n, 3), or not finite.

    Examples
    --------
    >>> (Q([[1, 0, 0]])[0] @ [0, 0, 1, 0]).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    q1, q2, q3 = as_vectors(q, "q").T
    o = np.zeros(len(q1))
    rows = [[o, -q1, -q2, -q3], [q1, o, -q3, q2], [q2, q3, o, -q1], [q3, -q2, q1, o]]
    return np.moveaxis(np.array(rows), 2, 0)


def M(p: ArrayLike, q: ArrayLike, weights: ArrayLike | None = None) -> FloatArray:
    """Matrix whose largest eigenvector is the rotation (Jia section 5, after eq. 17): ``sum P_i^T Q_i``.

    Parameters
    ----------
    p, q : array_like, (n, 3)
        Matched vectors about their means, or directions.
    weights : array_like, (n,), optional
        Weights; 1 where not given.

    Returns
    -------
    ndarray, (4, 4)
        Symmetric; for a unit quaternion r, ``r^T M r`` is the sum (15) of ``(R p_i) . q_i``.

    Raises
    ------
    InputError
        If vectors are not (n, 3), or not finite; if weights are not n, finite and 0 or more.
    ValueError
        If the numbers of rows differ.

    Examples
    --------
    >>> np.linalg.eigvalsh(M([[1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 1, 0]])).round(12).tolist()
    [-2.0, 0.0, 0.0, 2.0]
    """
    left = P(p)
    w = np.ones(len(left)) if weights is None else as_weights(weights, "weights", len(left))
    return np.asarray(np.einsum("i,iab,iac->bc", w, left, Q(q)))
