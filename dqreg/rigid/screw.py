"""Screws: every rigid motion is a turn about a line and a shift along it (Chasles).

Equation numbers: Walker, Shao and Volz (1991). Their quaternions carry the scalar last, ours first; r4 and s4
are the scalars of the real and of the dual part.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dqreg.arrays import FloatArray, as_float, require_finite
from dqreg.errors import InputError
from dqreg.rigid.dual_number import DualNumber
from dqreg.rigid.operands import as_directions
from dqreg.rigid.quaternion_algebra import canonical_sign

# Half-angles below four rounding steps are noise of the real part, not a rotation.
_NO_TURN = 4.0 * float(np.finfo(np.float64).eps)


class Screw(NamedTuple):
    """A turn about a line and a shift along it.

    Parameters
    ----------
    axis : ndarray, (3,)
        Unit direction n of the line.
    angle_rad : float
        Right-handed angle theta about it, in [0, pi] when read off a pose.
    distance : float
        Shift d along ``axis``, in the unit of the pose.
    point : ndarray, (3,)
        A point p on the line; the one nearest the origin when read off a pose.

    Examples
    --------
    >>> Screw(np.array([0.0, 0.0, 1.0]), 0.5, 2.0, np.zeros(3)).distance
    2.0
    """

    axis: FloatArray
    angle_rad: float
    distance: float
    point: FloatArray


def screw_to_parts(axis: ArrayLike, angle: float, distance: float, point: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Real and dual part of a screw: sine and cosine of half the dual angle (eqs. 8-12).

    Shapes: real, dual (4,).
    """
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


def screw_from_parts(real: FloatArray, dual: FloatArray) -> Screw:
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

    Without a turn there is no line: a pure translation is a shift by ``|t|`` along ``t / |t|`` through the origin, and
    the identity a shift by 0 along x.

    Shapes: real, dual (4,).
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
