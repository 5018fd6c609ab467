"""Dual numbers a + eps b with eps^2 = 0, and screws: rotation about a line with translation along it.

Every rigid motion is a screw (Chasles). Equation numbers: Walker, Shao and Volz (1991), appendix 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError

# A number, or an array of them: what a single one gives is a float, and a checker of types may take it as one.
Numbers = Any


@dataclass(frozen=True, eq=False)
class DualNumber:
    """Dual numbers; as a dual angle theta + eps d: a rotation about and a translation along one line (eq. 10).

    ``+``, ``-``, ``*`` and ``/`` take real numbers too; ``==`` compares both parts.

    Parameters
    ----------
    real : float or ndarray
        Real part a.
    dual : float or ndarray
        Dual part b.

    Raises
    ------
    InputError
        In a division, if the real part of the divisor is 0 (eq. 53).

    Examples
    --------
    >>> DualNumber(2.0, 3.0) * DualNumber(5.0, 7.0)
    DualNumber(real=10.0, dual=29.0)
    """

    real: Numbers
    dual: Numbers

    # Leaves `array * number` to this class.
    __array_ufunc__ = None

    def __add__(self, other: DualNumber | Numbers) -> DualNumber:
        b = _as_dual(other)
        return DualNumber(self.real + b.real, self.dual + b.dual)

    def __sub__(self, other: DualNumber | Numbers) -> DualNumber:
        b = _as_dual(other)
        return DualNumber(self.real - b.real, self.dual - b.dual)

    def __mul__(self, other: DualNumber | Numbers) -> DualNumber:
        b = _as_dual(other)
        return DualNumber(self.real * b.real, self.real * b.dual + self.dual * b.real)

    def __truediv__(self, other: DualNumber | Numbers) -> DualNumber:
        b = _as_dual(other)
        if np.any(np.asarray(b.real) == 0.0):
            raise InputError("a dual number with real part 0 has no inverse (eq. 53)")
        ratio = self.real / b.real
        return DualNumber(ratio, (self.dual - ratio * b.dual) / b.real)

    def __neg__(self) -> DualNumber:
        return DualNumber(-self.real, -self.dual)

    def __radd__(self, other: Numbers) -> DualNumber:
        return self.__add__(other)

    def __rsub__(self, other: Numbers) -> DualNumber:
        return DualNumber(other, 0.0) - self

    def __rmul__(self, other: Numbers) -> DualNumber:
        return self.__mul__(other)

    def __rtruediv__(self, other: Numbers) -> DualNumber:
        return DualNumber(other, 0.0) / self

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DualNumber):
            return NotImplemented
        return np.array_equal(self.real, other.real) and np.array_equal(self.dual, other.dual)

    def __hash__(self) -> int:
        return hash((np.asarray(self.real, float).tobytes(), np.asarray(self.dual, float).tobytes()))

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

    def modulus(self) -> Numbers:
        """Return a, which may be negative (eq. 54).

        Returns
        -------
        float or ndarray
            The modulus.

        Examples
        --------
        >>> DualNumber(-2.0, 3.0).modulus()
        -2.0
        """
        return self.real

    def extend(self, function: Callable[[Any], Any], derivative: Callable[[Any], Any]) -> DualNumber:
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
        return DualNumber(plain(function(self.real)), plain(self.dual * derivative(self.real)))

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
        return self.extend(np.sin, np.cos)

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
        return self.extend(np.cos, lambda angle_rad: -np.sin(angle_rad))

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
        if not np.all(np.asarray(self.real) > 0.0):
            lowest = float(np.min(self.real))
            raise InputError(f"a dual number needs a positive real part to have a root; got {lowest:g}")
        return self.extend(np.sqrt, lambda x: 0.5 / np.sqrt(x))

    def exp(self) -> DualNumber:
        """Return e^a + eps b e^a (eq. 55).

        Returns
        -------
        DualNumber
            The exponential.

        Examples
        --------
        >>> DualNumber(0.0, 3.0).exp()
        DualNumber(real=1.0, dual=3.0)
        """
        return self.extend(np.exp, np.exp)

    def arctan2(self, cosine: DualNumber) -> DualNumber:
        """Return the dual angle of a dual sine, this number, and a dual cosine (eqs. 10 and 52).

        Parameters
        ----------
        cosine : DualNumber
            The cosine, times the same factor as the sine.

        Returns
        -------
        DualNumber
            theta in (-pi, pi] and d.

        Raises
        ------
        InputError
            If the real parts of sine and cosine are both 0.

        Examples
        --------
        >>> angle = DualNumber(0.5, 3.0)
        >>> round(angle.sin().arctan2(angle.cos()).dual, 12)
        3.0
        """
        theta = np.arctan2(self.real, cosine.real)
        square = self.real * self.real + cosine.real * cosine.real
        if np.any(np.asarray(square) == 0.0):
            raise InputError("sine and cosine are both 0; there is no angle")
        return DualNumber(plain(theta), plain((cosine.real * self.dual - self.real * cosine.dual) / square))


class Screw(NamedTuple):
    """A rotation about a line and a translation along it.

    Parameters
    ----------
    axis : ndarray, (..., 3)
        Unit direction n of the line.
    angle_rad : float or ndarray, (...)
        Right-handed angle theta about it, in [0, pi] when read off a pose.
    distance : float or ndarray, (...)
        Translation d along ``axis``, in the unit of the pose.
    point : ndarray, (..., 3)
        A point p on the line; the one nearest the origin when read off a pose.

    Examples
    --------
    >>> import numpy as np
    >>> Screw(np.array([0.0, 0.0, 1.0]), 0.5, 2.0, np.zeros(3)).distance
    2.0
    """

    axis: FloatArray
    angle_rad: Numbers
    distance: Numbers
    point: FloatArray


def plain(value: Any) -> Any:
    """A plain number where there is only one. Shapes: value (...)."""
    array = np.asarray(value)
    return float(array) if array.ndim == 0 else array


def _as_dual(value: DualNumber | Numbers) -> DualNumber:
    return value if isinstance(value, DualNumber) else DualNumber(value, 0.0)
