"""Dual numbers a + eps b with eps^2 = 0, and screws: rotation about a line with translation along it.

Every rigid motion is a screw (Chasles). Equation numbers: Walker, Shao and Volz (1991), appendix 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from dqreg._arrays import FloatArray
from dqreg.errors import InputError


@dataclass(frozen=True)
class DualNumber:
    """One dual number; as a dual angle theta + eps d it is a rotation about and a translation along one line (eq. 10).

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


class Screw(NamedTuple):
    """A rotation about a line and a translation along it.

    Parameters
    ----------
    axis : ndarray, (3,)
        Unit direction n of the line.
    angle_rad : float
        Right-handed angle theta about it, in [0, pi] when read off a pose.
    distance : float
        Translation d along ``axis``, in the unit of the pose.
    point : ndarray, (3,)
        A point p on the line; the one nearest the origin when read off a pose.

    Examples
    --------
    >>> import numpy as np
    >>> Screw(np.array([0.0, 0.0, 1.0]), 0.5, 2.0, np.zeros(3)).distance
    2.0
    """

    axis: FloatArray
    angle_rad: float
    distance: float
    point: FloatArray
