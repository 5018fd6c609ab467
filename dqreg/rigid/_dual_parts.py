"""Arithmetic of unit dual quaternions on their parts: real and dual, four numbers each, scalar first.

Equation numbers: Walker, Shao and Volz (1991). Their quaternions carry the scalar last, ours first; r4 and s4
are the scalars of the real and of the dual part.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, require_finite
from dqreg.errors import InputError
from dqreg.rigid._algebra import canonical_sign, multiply
from dqreg.rigid._operands import as_directions
from dqreg.rigid._powers import exp as quaternion_exp
from dqreg.rigid.rotations import left_jacobian
from dqreg.rigid.screw import DualNumber, Screw

Parts = tuple[FloatArray, FloatArray]

# Far above the rounding of one operation, far below anything a careless caller gives.
UNIT_TOLERANCE = 1e-9
# Below it floating point has no relative precision to hold anyone to.
_SMALLEST = float(np.finfo(np.float64).tiny)
# Half-angles below four rounding steps are noise of the real part, not a rotation.
_NO_TURN = 4.0 * float(np.finfo(np.float64).eps)


def constraint_residuals(real: FloatArray, dual: FloatArray) -> tuple[float, float]:
    """``r . r - 1`` and ``r . s`` (eqs. 13-14)."""
    return float(real @ real) - 1.0, float(real @ dual)


def require_unit(real: FloatArray, dual: FloatArray) -> None:
    """Raise where the parts break the constraints."""
    unit_residual, perpendicular_residual = constraint_residuals(real, dual)
    # Written so that NaN fails; the dual part is a length, so its tolerance is relative.
    if not abs(unit_residual) <= UNIT_TOLERANCE:
        raise InputError(
            f"the real part of a unit dual quaternion has norm 1; its square is off by {unit_residual:.3g} "
            f"(allowed {UNIT_TOLERANCE:g}). Divide both parts by the norm first if a scale is not meant"
        )
    largest = float(np.abs(dual).max())  # a norm would square numbers of 1e-160 away
    if not abs(perpendicular_residual) <= UNIT_TOLERANCE * largest + _SMALLEST:
        raise InputError(
            "the parts of a unit dual quaternion are perpendicular; their product is "
            f"{perpendicular_residual:.3g} for a dual part with components up to {largest:.3g}"
        )


def onto_constraints(real: FloatArray, dual: FloatArray) -> Parts:
    """Our own results without their rounding, so that it does not pile up in long products."""
    # The translation does not depend on the part of `dual` along `real`. The second pass is for duals of rounding only.
    real = real / np.linalg.norm(real)
    for _ in range(2):
        dual = dual - (real @ dual) * real
    return real, dual


def product(a: Parts, b: Parts) -> Parts:
    """The motion b followed by a (eq. 51)."""
    left = multiply(a[0], b[1])
    return onto_constraints(multiply(a[0], b[0]), left + multiply(a[1], b[0]))


def with_translation(real: FloatArray, t: FloatArray) -> Parts:
    """Rotation and translation (eq. 25)."""
    # s = W(r) t with the translation quaternion (0, t) / 2.
    return onto_constraints(real, multiply(np.concatenate([[0.0], t / 2.0]), real))


def exp(twist: ArrayLike) -> Parts:
    """Screw motion of a twist (6,)."""
    numbers = as_float(twist, "twist")
    if numbers.shape != (6,):
        raise InputError(f"twist must hold six numbers, rotation first, then translation; got {numbers.shape}")
    require_finite(numbers, "twist")
    w, v = numbers[:3], numbers[3:]
    real = quaternion_exp(np.concatenate([[0.0], w / 2.0]))
    return with_translation(real, left_jacobian(w) @ v)


def from_screw(axis: ArrayLike, angle: float, distance: float, point: ArrayLike) -> Parts:
    """Real and dual part of a screw: sine and cosine of half the dual angle (eqs. 8-12)."""
    n, p = as_directions(axis, "axis"), as_float(point, "point")
    numbers = np.array([as_float(angle, "angle"), as_float(distance, "distance")])
    if n.shape != (3,) or p.shape != (3,) or numbers.shape != (2,):
        raise InputError(f"a screw needs one axis and one point of three numbers; got {n.shape} and {p.shape}")
    require_finite(numbers, "angle and distance")
    require_finite(p, "point")
    half = DualNumber(float(numbers[0]) / 2.0, float(numbers[1]) / 2.0)  # half of eq. 10
    sine, cosine = half.sin(), half.cos()
    moment = np.cross(p, n)  # dual part of the line's dual vector, eqs. 9 and 60
    real = np.concatenate([[cosine.real], sine.real * n])
    dual = np.concatenate([[cosine.dual], sine.dual * n + sine.real * moment])
    return real, dual


def as_screw(real: FloatArray, dual: FloatArray) -> Screw:
    """Screw of a unit dual quaternion (appendix 3, eqs. 70-75, two of them corrected).

    Eq. 12 reads ``s = (d/2) cos(theta/2) n + sin(theta/2) m`` with the moment ``m = p x n``, and ``s4 = -(d/2)
    sin(theta/2)``.

    - Eq. 70 prints ``d = 2 s4 / sin(theta/2)``; by eq. 12 the sign is wrong, ``d = -2 s4 / sin(theta/2)``. As n is
      perpendicular to m, eq. 71 times n gives ``s . n = (d/2) cos(theta/2)`` too. The two are weighed by sine and
      cosine, ``d = 2 (cos(theta/2) s . n - sin(theta/2) s4)``, which divides by nothing.
    - Eqs. 71-73 then give m. Eq. 74 adds any multiple of n to a particular solution (not to a vector of the
      null space, as printed). Eq. 75 as printed is no solution, since it does not contain m. Two that are:
      ``(0, -m3, m2) / n1``, which solves ``p x n = m`` row by row with p1 = 0 and fails for n1 = 0; and
      ``n x m = p - (n . p) n``, the point nearest the origin, which never fails and is returned.

    Without a rotation there is no line: a pure translation has the axis ``t / |t|`` through the origin and the distance
    ``|t|``, the identity the axis x and the distance 0.
    """
    sign = canonical_sign(real)
    r4, r, s4, s = float(sign * real[0]), sign * real[1:], float(sign * dual[0]), sign * dual[1:]
    sine = float(np.linalg.norm(r))
    if sine <= _NO_TURN:
        half_shift = float(np.linalg.norm(s))
        axis = s / half_shift if half_shift > 0.0 else np.array([1.0, 0.0, 0.0])
        return Screw(axis, 0.0, 2.0 * half_shift, np.zeros(3))
    n = r / sine
    along = float(s @ n)
    half_distance = r4 * along - sine * s4
    # n x s / sin(theta/2) is n x m: the part of s along n drops out.
    return Screw(n, 2.0 * math.atan2(sine, r4), 2.0 * half_distance, np.cross(n, s) / sine)
