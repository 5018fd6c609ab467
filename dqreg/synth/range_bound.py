"""Cramer-Rao bound of a pose from ranges along known rays; `dqreg.solvers.cramer_rao` is that of given matches."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_vectors
from dqreg.errors import DegenerateGeometryError, InputError


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
