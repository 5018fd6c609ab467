"""Newton's method on poses for a quadratic form, with exact first and second derivatives.

Increments are left twists about the target origin of the form: ``T = about(exp(twist), origin) @ T0``.
"""

from __future__ import annotations

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.rigid import pose, twist
from dqreg.solvers.quadratic import QuadraticForm

STEPS = 50
# A predicted gain below this share of the cost's scale is rounding.
NOTHING = 1e-15
# Curvature below this share of the largest leaves the motion where it is.
FLAT = 1e-9

_GENERATORS = np.zeros((3, 3, 3))
for _k in range(3):
    _GENERATORS[_k] = np.cross(np.eye(3)[_k], np.eye(3)).T


def derivatives(form: QuadraticForm, T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gradient and Hessian of the cost with respect to a left twist, at zero.

    From ``R' = (I + W + W^2/2) R`` and ``t' = (I + W + W^2/2) t + (I + W/2) v`` up to second order.

    Parameters
    ----------
    form : QuadraticForm
        The cost.
    T : ndarray, (4, 4)
        Pose.

    Returns
    -------
    gradient : ndarray, (6,)
        Rotation first, then translation.
    hessian : ndarray, (6, 6)
        Symmetric.
    squares : ndarray, (6, 6)
        Its part from products of first derivatives (Gauss-Newton), positive semidefinite.
    """
    y = form.coordinates(T)
    R, t = T[:3, :3], y[9:12]
    J = np.zeros((13, 6))
    J[:9, :3] = (_GENERATORS @ R).reshape(3, 9).T
    J[9:12, :3] = (_GENERATORS @ t).T
    J[9:12, 3:] = np.eye(3)
    slope = 2.0 * form.matrix @ y
    squares = 2.0 * J.T @ form.matrix @ J
    hessian = squares.copy()
    # <slope, second derivative of y>: W_k W_l summed both ways, against (R, t); and W_k v / 2.
    pull = slope[:9].reshape(3, 3) @ R.T + np.outer(slope[9:12], t)
    products = np.einsum("kia,lab->klib", _GENERATORS, _GENERATORS)
    curved = np.einsum("klib,ib->kl", products, pull)
    hessian[:3, :3] += 0.5 * (curved + curved.T)
    mixed = 0.5 * np.einsum("i,kil->kl", slope[9:12], _GENERATORS)
    hessian[:3, 3:] += mixed
    hessian[3:, :3] += mixed.T
    return J.T @ slope, hessian, squares


def minimise(form: QuadraticForm, start: FloatArray) -> FloatArray:
    """Pose of least cost near a start.

    Damped Newton steps that never raise the cost; motions that the cost does not feel stay as they are.

    Parameters
    ----------
    form : QuadraticForm
        The cost.
    start : ndarray, (4, 4)
        Where to begin.

    Returns
    -------
    ndarray, (4, 4)
        Rigid pose.
    """
    T, value, damping = start, form.value(start), 0.0
    scale = max(abs(form.matrix[12, 12]), value, np.finfo(float).tiny)
    for _ in range(STEPS):
        slope, curvature, motions = _felt(form, T)
        while True:
            step = -slope / (curvature * (1.0 + damping))
            # A gain this small is within the rounding of the cost: the step is right even where the cost seems to rise.
            last = bool(-step @ slope <= NOTHING * scale)
            candidate = _moved(form, T, motions @ step)
            reached = form.value(candidate)
            if reached <= value or last or damping > 1e6:
                break
            damping = max(4.0 * damping, 1e-2)
        if reached > value and not last:
            return T
        T, value, damping = candidate, reached, 0.25 * damping
        if last:
            break
    return T


def _felt(form: QuadraticForm, T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Slope, curvature and twists of the independent motions that the cost feels at a pose."""
    gradient, hessian, squares = derivatives(form, T)
    # Turns and shifts in one unit, so that "flat" means the same for both.
    lever = np.sqrt(np.trace(squares[:3, :3]) / max(np.trace(squares[3:, 3:]), np.finfo(float).tiny))
    unit = np.r_[[1.0 / lever if lever > 0.0 else 1.0] * 3, [1.0] * 3]
    strength, motions = np.linalg.eigh(squares * unit[:, None] * unit)
    # The squares decide what is felt: on a plane the full Hessian sees curvature even in a pure slide.
    motions = unit[:, None] * motions[:, strength > FLAT * strength.max()]
    curvature, turned = np.linalg.eigh(motions.T @ hessian @ motions)
    motions = motions @ turned
    # Negative curvature is walked down, not up.
    return motions.T @ gradient, np.maximum(np.abs(curvature), FLAT * np.abs(curvature).max()), motions


def _moved(form: QuadraticForm, T: FloatArray, increment: FloatArray) -> FloatArray:
    moved: FloatArray = pose.about(twist.exp(increment), form.origin_target) @ T
    return moved
