"""Dual numbers a + eps b with eps^2 = 0: Walker, Shao and Volz (1991), appendix 1, eqs. 51-57.

Screws: every rigid motion is a turn about a line and a shift along it (Chasles).

Equation numbers: Walker, Shao and Volz (1991). Their quaternions carry the scalar last, ours first; r4 and s4
are the scalars of the real and of the dual part.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, require_finite
from dqreg.errors import InputError
from dqreg.rigid.operands import as_directions
from dqreg.rigid.quaternion_algebra import canonical_sign


@dataclass(frozen=True)
class DualNumber:
    """One dual number; as a dual angle theta + eps d it holds a turn and a shift along one line (eqs. 10, 52).

    Parameters
    ----------
    real : float
        Real part a.
    dual : float
        Dual part b.

    Examples
    --------
    >>> DualNumber(2.0, 3.0) * DualNumber(5.0, 7.0)
    DualNumber(real=10.0, dual=29.0)
    """

    real: float
    dual: float

    def __add__(self, other: DualNumber) -> DualNumber:
        return DualNumber(self.real + other.real, self.dual + other.dual)

    def __sub__(self, other: DualNumber) -> DualNumber:
        return DualNumber(self.real - other.real, self.dual - other.dual)

    def __mul__(self, other: DualNumber) -> DualNumber:
        return DualNumber(self.real * other.real, self.real * other.dual + self.dual * other.real)

    def conjugate(self) -> DualNumber:
        """Return a - eps b, whose product with the number is a^2 (eq. 53).

        Returns
        -------
        DualNumber
            The conjugate.

        Examples
        --------
        >>> DualNumber(2.0, 3.0).conjugate()
        DualNumber(real=2.0, dual=-3.0)
        """
        return DualNumber(self.real, -self.dual)

    def modulus(self) -> float:
        """Return a, which may be negative (eq. 54).

        Returns
        -------
        float
            The modulus.

        Examples
        --------
        >>> DualNumber(-2.0, 3.0).modulus()
        -2.0
        """
        return self.real

    def extend(self, function: Callable[[float], float], derivative: Callable[[float], float]) -> DualNumber:
        """Carry a function of real numbers over: f(a + eps b) = f(a) + eps b f'(a) (eqs. 55, 58, 59).

        Parameters
        ----------
        function : callable
            f.
        derivative : callable
            f'.

        Returns
        -------
        DualNumber
            Value of the extended function.

        Examples
        --------
        >>> DualNumber(2.0, 3.0).extend(lambda x: x**3, lambda x: 3 * x**2)
        DualNumber(real=8.0, dual=36.0)
        """
        return DualNumber(function(self.real), self.dual * derivative(self.real))

    def sin(self) -> DualNumber:
        """Return sin(theta) + eps d cos(theta) (eq. 56).

        Returns
        -------
        DualNumber
            The sine.

        Examples
        --------
        >>> DualNumber(0.0, 3.0).sin()
        DualNumber(real=0.0, dual=3.0)
        """
        return self.extend(math.sin, math.cos)

    def cos(self) -> DualNumber:
        """Return cos(theta) - eps d sin(theta) (eq. 57).

        Returns
        -------
        DualNumber
            The cosine.

        Examples
        --------
        >>> DualNumber(0.0, 3.0).cos().real
        1.0
        """
        return self.extend(math.cos, lambda angle_rad: -math.sin(angle_rad))

    def sqrt(self) -> DualNumber:
        """Return sqrt(a) + eps b / (2 sqrt(a)) (eq. 55).

        Returns
        -------
        DualNumber
            The square root.

        Raises
        ------
        InputError
            If the real part is not positive: the root of zero has no derivative.

        Examples
        --------
        >>> DualNumber(9.0, 12.0).sqrt()
        DualNumber(real=3.0, dual=2.0)
        """
        if not self.real > 0.0:
            raise InputError(f"a dual number needs a positive real part to have a root; got {self.real:g}")
        return self.extend(math.sqrt, lambda x: 0.5 / math.sqrt(x))


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
