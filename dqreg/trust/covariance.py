"""What the matches say about the pose: information of the six motions, and the covariance that follows."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import BoolArray, FloatArray

# Information below this share of what all pairs could give with the longest lever is rounding or facets, not shape.
FREE = 1e-5


@dataclasses.dataclass(frozen=True)
class Information:
    """Information of the six motions in units that compare turns with shifts.

    A twist (rotation vector w, translation v) about the centre is scaled to (w L, v) with the lever L, half the
    diagonal, so that all six numbers are displacements on the part.

    Attributes
    ----------
    values : ndarray, (6,)
        Eigenvalues over the sum of weights, ascending; about 1 where every pair works against a motion.
    vectors : ndarray, (6, 6)
        Scaled twists, one a column.
    weight : float
        Sum of weights.
    sigma : float
        Standard deviation of a pair's distance along the normal.
    lever : float
        The length L.
    centre : ndarray, (3,)
        Where turns are about, target frame.
    """

    values: FloatArray
    vectors: FloatArray
    weight: float
    sigma: float
    lever: float
    centre: FloatArray

    @property
    def free(self) -> BoolArray:
        """Which of the six motions the matches leave free, (6,)."""
        return np.asarray(self.values < FREE)


def information_of(
    points: FloatArray,
    normals: FloatArray,
    residuals: FloatArray,
    weights: FloatArray,
    lever: float,
    centre: FloatArray,
) -> Information:
    """Information from distances along the target's normals: sliding along a face costs nothing.

    With rows ``J_i = [(x_i - c) x n_i, n_i]`` it is ``sum w_i J_i^T J_i``, the Gauss-Newton Hessian of the
    point-to-plane cost.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Source points in the target frame.
    normals : ndarray, (n, 3)
        Target normals; a zero row says nothing.
    residuals : ndarray, (n,)
        Distances along the normals.
    weights : ndarray, (n,)
        Weights of the pairs, probabilities to be an inlier.
    lever : float
        Half the diagonal of the target.
    centre : ndarray, (3,)
        Middle of the target.

    Returns
    -------
    Information
        Eigenvalues, motions and noise.

    Examples
    --------
    >>> flat = np.column_stack([np.random.default_rng(0).uniform(-1, 1, (50, 2)), np.zeros(50)])
    >>> up = np.tile([0.0, 0, 1], (50, 1))
    >>> info = information_of(flat, up, np.zeros(50), np.ones(50), 1.0, np.zeros(3))
    >>> int(info.free.sum())
    3
    """
    total = float(weights.sum())
    rows = plane_rows(points, normals, centre, lever)
    matrix = (rows * weights) @ rows.T / max(total, np.finfo(float).tiny)
    values, vectors = np.linalg.eigh(matrix)
    variance = float(weights @ residuals**2) / max(total - 6.0, 1.0)
    return Information(np.maximum(values, 0.0), vectors, total, float(np.sqrt(variance)), lever, centre)


def plane_rows(points: FloatArray, normals: FloatArray, centre: FloatArray, lever: float) -> FloatArray:
    """Derivatives of the distances along the normals by the six scaled motions, one motion a row.

    Parameters
    ----------
    points, normals : ndarray, (n, 3)
        Where, and along what.
    centre : ndarray, (3,)
        What turns are about.
    lever : float
        Length that makes a displacement of a turn.

    Returns
    -------
    ndarray, (6, n)
        ``(x - c) x n / L`` over ``n``.
    """
    # By columns: three numbers a row are too few for NumPy to be quick about.
    x, y, z = np.ascontiguousarray(points.T) - centre[:, None]
    u, v, w = along = np.ascontiguousarray(normals.T)
    arms = np.stack([y * w - z * v, z * u - x * w, x * v - y * u]) / lever
    return np.vstack([arms, along])


def covariance_of(information: Information) -> FloatArray:
    """Covariance of the twist (rotation vector, translation) about the centre, as a left increment.

    ``sigma^2 (J^T W J)^-1``, as if the distances of all pairs were independent; noise that neighbours share makes
    the true one larger.

    Parameters
    ----------
    information : Information
        From `information_of`.

    Returns
    -------
    ndarray, (6, 6)
        Symmetric, rad^2 and length^2; NaN in the rows and columns that a free motion takes part in.

    Examples
    --------
    >>> held = Information(np.ones(6), np.eye(6), 100.0, 0.1, 2.0, np.zeros(3))
    >>> np.sqrt(np.diag(covariance_of(held))).tolist()
    [0.005, 0.005, 0.005, 0.01, 0.01, 0.01]
    """
    held = ~information.free
    vectors = information.vectors[:, held]
    scaled = (vectors / (information.values[held] * information.weight)) @ vectors.T * information.sigma**2
    unscale = np.r_[[1.0 / information.lever] * 3, [1.0] * 3]
    covariance: FloatArray = scaled * unscale[:, None] * unscale
    touched = (np.abs(information.vectors[:, ~held]) > 1e-6).any(axis=1)
    covariance[touched] = np.nan
    covariance[:, touched] = np.nan
    return covariance
