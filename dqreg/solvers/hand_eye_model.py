"""Maximum likelihood of AX = YB: what X and Y predict of every B, how far B is from it, and Gauss-Newton steps.

Each B is predicted as ``Y^-1 A X``. With isotropic noise of the rotation and, apart from it, of the translation of B
and of A, the residuals

    e = log(R_B R^T),    d = t_B - t,        R = R_Y^T R_A R_X,  t = R_Y^T (R_A t_X + t_A - t_Y)

have, turned by R_Y, the covariance of B plus what the noise of A carries there: its rotation moves ``u = R_A t_X``. The
rotations of X and Y are moved from the left and their translations by a sum, so the covariance is that of a left
increment about the origin of X (and of Y).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import pose, quaternion
from dqreg.rigid.rotations import from_rotation_vector

MAX_STEPS = 25
# Steps, in standard deviations, that are none, and those so small that they are taken without a look at the cost: the
# weights of the residuals move a little with X, and the cost with them.
AT_REST_SIGMAS, SMALL_STEP_SIGMAS = 1e-7, 1e-2


@dataclass(frozen=True)
class HandEyeNoise:
    """Standard deviations: rotations in radians, translations in lengths, of each of three components."""

    turn_a: float
    shift_a: float
    turn_b: float
    shift_b: float


@dataclass(frozen=True, eq=False)
class HandEyeEstimate:
    """X and Y with the residuals they leave and the information about them."""

    X: FloatArray
    Y: FloatArray
    rotations: FloatArray  # (n, 3): e, turned by R_Y
    translations: FloatArray  # (n, 3): d, turned by R_Y
    cost: float  # Sum of the squared residuals in standard deviations
    information: FloatArray  # (k, k): rotation and translation of X, then of Y where it is apart
    jacobian: FloatArray  # (n, 6, k): of the residuals in standard deviations

    @property
    def left(self) -> tuple[float, float]:
        """Degrees of freedom of the residuals of rotation and of translation, less what the fit takes from each."""
        scale = np.sqrt(self.information.diagonal())
        J = self.jacobian / scale
        inverse = np.linalg.pinv(self.information / scale / scale[:, None], hermitian=True)
        used = np.einsum("nij,jk,nik->i", J, inverse, J)
        count = 3 * len(J)
        return count - float(used[:3].sum()), count - float(used[3:].sum())


def estimate(A: FloatArray, B: FloatArray, X: FloatArray, Y: FloatArray | None, noise: HandEyeNoise) -> HandEyeEstimate:
    """Most likely X, and Y where it is given, near the given ones; Y is X elsewhere. Shapes: A, B (n, 4, 4)."""
    best = _at(A, B, X, Y, noise)
    damping = 0.0
    for _ in range(MAX_STEPS):
        here, slope = best
        scale = np.sqrt(here.information.diagonal())
        normal = here.information / scale / scale[:, None]
        step = np.linalg.lstsq(normal + damping * np.eye(len(normal)), slope / scale, rcond=None)[0] / scale
        X_next = _moved(here.X, step[:6])
        reached = _at(A, B, X_next, None if Y is None else _moved(here.Y, step[6:]), noise)
        length = float(np.abs(step * scale).max())
        if length < SMALL_STEP_SIGMAS or reached[0].cost <= here.cost:
            best, damping = reached, 0.1 * damping
        elif damping > 1e6:
            break
        else:
            damping = max(10.0 * damping, 1e-3)
            continue
        if length < AT_REST_SIGMAS:
            break
    return best[0]


def _at(
    A: FloatArray, B: FloatArray, X: FloatArray, Y: FloatArray | None, noise: HandEyeNoise
) -> tuple[HandEyeEstimate, FloatArray]:
    """The estimate as it stands, with the negative gradient of half the cost."""
    apart, Y = Y is not None, X if Y is None else Y
    R_Y, R_A = Y[:3, :3], A[:, :3, :3]
    u = A[:, :3, :3] @ X[:3, 3]
    v = u + A[:, :3, 3] - Y[:3, 3]
    turned = pose.from_parts(B[:, :3, :3] @ np.swapaxes(R_Y.T @ R_A @ X[:3, :3], -1, -2), np.zeros(3))
    e = pose.log(turned)[:, :3] @ R_Y.T
    d = B[:, :3, 3] @ R_Y.T - v
    # Derivatives of (e, d), turned by R_Y, by rotation and translation of X, then of Y.
    J = np.zeros((len(A), 6, 12))
    J[:, :3, :3], J[:, 3:, 3:6] = -R_A, -R_A
    J[:, :3, 6:9] = J[:, 3:, 9:] = np.eye(3)
    J[:, 3:, 6:9] = -quaternion.cross_matrix(v)
    J = J if apart else J[:, :, :6] + J[:, :, 6:]
    root = np.linalg.cholesky(_covariances(u, noise))
    r = np.linalg.solve(root, np.concatenate([e, d], axis=1)[..., None])[..., 0]
    J = np.linalg.solve(root, J)
    information = np.einsum("nij,nik->jk", J, J)
    slope = -np.einsum("nij,ni->j", J, r)
    return HandEyeEstimate(X, Y, e, d, float(np.square(r).sum()), information, J), slope


def _covariances(u: FloatArray, noise: HandEyeNoise) -> FloatArray:
    U = quaternion.cross_matrix(u)
    C = np.zeros((len(u), 6, 6))
    turn = noise.turn_a**2
    C[:, :3, :3] = (turn + noise.turn_b**2) * np.eye(3)
    # A rotation w of A turns e by -w and d by u x w.
    C[:, 3:, :3] = -turn * U
    C[:, :3, 3:] = -turn * np.swapaxes(U, -1, -2)
    C[:, 3:, 3:] = turn * U @ np.swapaxes(U, -1, -2) + (noise.shift_a**2 + noise.shift_b**2) * np.eye(3)
    return C


def _moved(T: FloatArray, step: FloatArray) -> FloatArray:
    R = from_rotation_vector(step[:3]) @ T[:3, :3]
    # Many small steps would wear the rotation out.
    return pose.from_parts(quaternion.to_matrix(quaternion.from_matrix(R)), T[:3, 3] + step[3:])
