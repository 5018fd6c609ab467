r"""Cramer-Rao bounds of a pose: of ranges along known rays, and of measured points and directions.

`cramer_rao_bound` is that of ranges; its docstring derives it. The others are of points and directions with known
correspondences, and of the weights that least squares give them.

Let a model point p be measured as ``q = R p + t + e`` with e Gaussian, sigma_p on each coordinate, and a model
direction m as n, which is ``R m`` tilted by Gaussian angles, sigma_n along each of the two ways across it. Move the
pose by a small rotation omega about a point c and a translation tau. A point then moves by

    omega x (x - c) + tau = J (omega, tau),     J = (-[x - c]x, I),     x = R p + t,

and a direction by ``omega x n = -[n]x omega``, always across itself. The log-likelihood is, to second order,
``-|q - x|^2 / (2 sigma_p^2) - |n - R m|^2 / (2 sigma_n^2)`` summed over all correspondences, so the Fisher information
is

    F = sum J^T J / sigma_p^2 + sum diag(I - n n^T, 0) / sigma_n^2,

because ``[n]x^T [n]x = I - n n^T`` for a unit vector. No unbiased estimate of (omega, tau) has a covariance below
``F^-1``. The trace of its first block bounds the mean squared angle of the rotation error, the trace of its last
block that of the position of c.

Weighted least squares with the weights beta and alpha solve, to first order, ``A (omega, tau) = g`` with
``A = sum beta J^T J + sum alpha diag(I - n n^T, 0)``, and g has the covariance B, which is A with beta replaced by
``beta^2 sigma_p^2`` and alpha by ``alpha^2 sigma_n^2``. Their error has the covariance ``A^-1 B A^-1``. For
``beta = 1 / sigma_p^2`` and ``alpha = 1 / sigma_n^2`` (`dqreg.likelihood_weights`) A = B = F: the bound is reached.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_vectors
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid import quaternion


def cramer_rao_bound(
    points: ArrayLike, ray_directions: ArrayLike, normals: ArrayLike, sigma: ArrayLike, vertices: ArrayLike
) -> float:
    """Root mean square vertex displacement of the best unbiased pose.

    Parameters
    ----------
    points : array_like, (n, 3)
        Points on the surface where the rays meet it, outliers left out; in the part's frame.
    ray_directions : array_like, (n, 3)
        Unit direction of each ray, either way round.
    normals : array_like, (n, 3)
        Unit normal of the surface at each point, either way round.
    sigma : array_like, () or (n,)
        Standard deviation of the range noise along the rays; a length above zero.
    vertices : array_like, (v, 3)
        Where the displacement counts: the vertices of the part, in its frame.

    Returns
    -------
    float
        A length in the unit of the points.

    Raises
    ------
    InputError
        If shapes or numbers are wrong, or a ray runs along its surface.
    DegenerateGeometryError
        If the points leave a direction of motion undetermined; the bound is then infinite.

    Notes
    -----
    Let the part be moved a little, ``x -> x + w x x + v``, and let a ray ``o + r d`` meet it at ``p`` on a
    face with normal ``n``. The face moves along its normal by ``n . (w x p + v)``, and the range must make up
    for it: ``dr (n . d) = n . (w x p + v)``, hence::

        dr/d(w, v) = J = [p x n, n] / (n . d)

    since ``n . (w x p) = w . (p x n)``. Ranges are ``r + e`` with independent ``e ~ N(0, sigma^2)``, so the
    Fisher information is ``F = sum J^T J / sigma^2`` and the covariance of any unbiased estimate of ``(w,
    v)`` is at least ``C = F^-1``. A vertex ``a`` moves by ``A (w, v)`` with ``A = [-[a]_x, I]``; its mean
    square displacement is ``trace(A C A^T)``. The mean over all vertices, and its root, is the bound. It does
    not depend on the origin; the sums are taken about the vertices' mean, with turns measured in vertex
    spreads, so that they are well scaled.

    Examples
    --------
    >>> axes = np.repeat(np.eye(3), 2, axis=0)  # two rays on each of three faces of a cube
    >>> points = np.array([[1, 0, 1], [1, 0, -1], [1, 1, 0], [-1, 1, 0], [0, 1, 1], [0, -1, 1.0]])
    >>> corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1.0)])
    >>> round(cramer_rao_bound(points, axes, axes, 0.1, corners), 6)
    0.212132
    """
    P, D, N = (
        as_vectors(a, n) for a, n in ((points, "points"), (ray_directions, "ray_directions"), (normals, "normals"))
    )
    V, s = as_vectors(vertices, "vertices"), as_float(sigma, "sigma")
    if not len(P) == len(D) == len(N) or s.shape not in ((), (len(P),)) or not len(V):
        raise InputError(
            "points, ray_directions, normals and sigma must go together and vertices must not be empty; "
            f"got {len(P)}, {len(D)}, {len(N)} rows, sigma of shape {s.shape} and {len(V)} vertices"
        )
    cosine = np.einsum("ni,ni->n", N, D)
    if not (np.isfinite(s) & (s > 0.0)).all() or (np.abs(cosine) < 1e-9).any():
        raise InputError("sigma must be above zero and no ray may run along its surface (normal . ray = 0)")
    origin = V.mean(axis=0)
    spread = float(np.sqrt(((V - origin) ** 2).sum(axis=1).mean())) or 1.0
    J = np.hstack([np.cross((P - origin) / spread, N), N]) / (s * cosine)[:, None]
    return float(np.sqrt(_mean_square_displacement(J.T @ J, (V - origin) / spread)))


def weighted_information(
    points: FloatArray, directions: FloatArray, centre: FloatArray, beta: float, alpha: float
) -> FloatArray:
    """Sum ``beta J^T J + alpha diag(I - n n^T, 0)`` over points and directions.

    Shapes: points (..., n, 3), directions (..., m, 3), returns (..., 6, 6).
    """
    away = points - np.asarray(centre)[..., np.newaxis, :]
    J = np.concatenate([-quaternion.cross_matrix(away), np.broadcast_to(np.eye(3), (*away.shape, 3))], axis=-1)
    total = beta * np.einsum("...nki,...nkj->...ij", J, J)
    across = np.eye(3) * directions.shape[-2] - np.einsum("...ni,...nj->...ij", directions, directions)
    total[..., :3, :3] += alpha * across
    return np.asarray(total)


def cramer_rao(
    points: FloatArray, directions: FloatArray, centre: FloatArray, sigma_p: float, sigma_n: float
) -> FloatArray:
    """Covariance that no unbiased estimate can undercut. Shapes: returns (..., 6, 6)."""
    information = weighted_information(points, directions, centre, sigma_p**-2, sigma_n**-2)
    return np.asarray(np.linalg.inv(information), dtype=np.float64)


def covariance_of_weights(
    points: FloatArray,
    directions: FloatArray,
    centre: FloatArray,
    sigmas: tuple[float, float],
    weights: tuple[float, float],
) -> FloatArray:
    """Covariance that weighted least squares reach, ``A^-1 B A^-1``. Shapes: returns (..., 6, 6)."""
    (sigma_p, sigma_n), (beta, alpha) = sigmas, weights
    inverse = np.linalg.inv(weighted_information(points, directions, centre, beta, alpha))
    B = weighted_information(points, directions, centre, (beta * sigma_p) ** 2, (alpha * sigma_n) ** 2)
    return np.asarray(inverse @ B @ inverse)


def rms_of(covariance: FloatArray) -> tuple[float, float]:
    """Root mean square rotation and translation of a covariance, or of a mean of several.

    Shapes: covariance (..., 6, 6).
    """
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    turn, shift = variances[..., :3].sum(axis=-1), variances[..., 3:].sum(axis=-1)
    return float(np.sqrt(turn.mean())), float(np.sqrt(shift.mean()))


def _mean_square_displacement(information: FloatArray, V: FloatArray) -> float:
    """Mean of trace(A C A^T) over vertices given in spreads about their mean, (v, 3)."""
    values, vectors = np.linalg.eigh(information)
    if values[0] <= 1e-12 * values[-1]:
        raise DegenerateGeometryError(
            "the points leave a direction of motion undetermined: the information's eigenvalues run from "
            f"{values[0]:.3g} to {values[-1]:.3g}. Add views that see faces with other normals"
        )
    turns, shifts = vectors[:3].T, vectors[3:].T
    # |w x a + v|^2 for each eigenvector, averaged over the vertices.
    moved = np.cross(turns[:, None], V[None]) + shifts[:, None]
    return float(((moved**2).sum(axis=2).mean(axis=1) / values).sum())
