"""Dual quaternions as numbers, eight of them: sums, products, conjugates, norm, signs, stacks.

That unit ones are rigid motions is the subject of `dqreg.rigid.dual_quaternion`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError
from dqreg.rigid import _dual_parts
from dqreg.rigid._algebra import canonical_sign, conjugate
from dqreg.rigid._operands import require_meeting
from dqreg.rigid.screw import DualNumber, plain


@dataclass(frozen=True, eq=False)
class DualAlgebra:
    """Pairs of quaternions (..., 4) over the dual numbers."""

    real: FloatArray
    dual: FloatArray
    # Known to keep the constraints; a sum or a multiple need not.
    _unit: bool = field(init=False, repr=False, default=False)

    # Leaves `array * self` to this class.
    __array_ufunc__ = None

    def __post_init__(self) -> None:
        parts = {name: as_float(getattr(self, name), name) for name in ("real", "dual")}
        for name, part in parts.items():
            if part.shape[-1:] != (4,):
                raise InputError(f"{name} must hold quaternions w, x, y, z in the last axis; got shape {part.shape}")
        try:
            shape = np.broadcast_shapes(*(part.shape for part in parts.values()))
        except ValueError:
            shapes = " and ".join(str(part.shape) for part in parts.values())
            raise InputError(f"real and dual must have shapes that broadcast; got {shapes}") from None
        # Copies, so that they can be locked.
        self._set(*(np.array(np.broadcast_to(part, shape)) for part in parts.values()), unit=True)
        _dual_parts.require_unit(self.real, self.dual)

    def _set(self, real: FloatArray, dual: FloatArray, *, unit: bool) -> None:
        for name, part in (("real", real), ("dual", dual)):
            part.flags.writeable = False
            object.__setattr__(self, name, part)
        object.__setattr__(self, "_unit", unit)

    @classmethod
    def _of(cls, real: FloatArray, dual: FloatArray, *, unit: bool = True) -> Self:
        """Fresh arrays, trusted. A sum is not of unit norm, and need not be."""
        new = object.__new__(cls)
        new._set(real, dual, unit=unit)
        return new

    @property
    def is_unit(self) -> bool:
        """Whether all of them are rigid motions: of norm 1 + eps 0, as the constructor asks (eqs. 13-14)."""
        return self._unit or _dual_parts.is_unit(self.real, self.dual)

    @property
    def shape(self) -> tuple[int, ...]:
        """Leading axes: () for a single one."""
        return self.real.shape[:-1]

    @classmethod
    def from_array(cls, numbers: ArrayLike, *, scalar_first: bool = True, normalize: bool = False) -> Self:
        """Read eight numbers each: the real, then the dual part.

        Parameters
        ----------
        numbers : array_like, (..., 8)
            Unit dual quaternions.
        scalar_first : bool
            Order within each part: w, x, y, z; or x, y, z, w with False.
        normalize : bool
            Whether to bring numbers that are of unit norm to a few digits only, as from a file, to norm 1.

        Returns
        -------
        DualQuaternion
            Of shape (...).

        Raises
        ------
        InputError
            If there are not eight numbers, or they break (13)-(14); with ``normalize`` if a real part is zero.

        Examples
        --------
        >>> from dqreg import DualQuaternion
        >>> DualQuaternion.from_array([1, 0, 0, 0, 0, 0, 0, 1.5]).translation.tolist()
        [0.0, 0.0, 3.0]
        """
        array = as_float(numbers, "numbers")
        if array.shape[-1:] != (8,):
            raise InputError(f"numbers must hold eight in the last axis, real part first; got shape {array.shape}")
        real, dual = array[..., :4], array[..., 4:]
        if not scalar_first:
            real, dual = np.roll(real, 1, axis=-1), np.roll(dual, 1, axis=-1)
        if not normalize:
            return cls(real, dual)
        return cls._of(real.copy(), dual.copy(), unit=False).normalized()

    def as_array(self, *, scalar_first: bool = True) -> FloatArray:
        """Write as eight numbers each: the real, then the dual part.

        Parameters
        ----------
        scalar_first : bool
            Order within each part: w, x, y, z; or x, y, z, w with False.

        Returns
        -------
        ndarray, (..., 8)
        """
        parts = (self.real, self.dual)
        return np.concatenate(parts if scalar_first else [np.roll(part, -1, axis=-1) for part in parts], axis=-1)

    def __mul__(self, other: Any) -> Self:
        if isinstance(other, DualAlgebra):
            require_meeting(left=self.shape, right=other.shape)
            parts = _dual_parts.product((self.real, self.dual), (other.real, other.dual))
            unit = self._unit and other._unit
            return self._of(*(_dual_parts.onto_constraints(*parts) if unit else parts), unit=unit)
        factor = as_float(other, "factor")
        require_meeting(factor=factor.shape, dual_quaternion=self.shape)
        factor = factor[..., np.newaxis]
        return self._of(self.real * factor, self.dual * factor, unit=False)

    def __rmul__(self, other: ArrayLike) -> Self:
        return self * other

    def __truediv__(self, other: ArrayLike) -> Self:
        return self * (1.0 / as_float(other, "divisor"))

    def __add__(self, other: Any) -> Self:
        if not isinstance(other, DualAlgebra):
            return NotImplemented
        require_meeting(left=self.shape, right=other.shape)
        return self._of(self.real + other.real, self.dual + other.dual, unit=False)

    def __sub__(self, other: Any) -> Self:
        if not isinstance(other, DualAlgebra):
            return NotImplemented
        return self + -other

    def __neg__(self) -> Self:
        return self._of(-self.real, -self.dual, unit=self._unit)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DualAlgebra):
            return NotImplemented
        return np.array_equal(self.real, other.real) and np.array_equal(self.dual, other.dual)

    def __hash__(self) -> int:
        return hash((self.shape, (self.as_array() + 0.0).tobytes()))

    def __bool__(self) -> bool:
        return True

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a single dual quaternion has no length")
        return self.shape[0]

    def __getitem__(self, key: Any) -> Self:
        if not self.shape:
            raise TypeError("a single dual quaternion has no items; its numbers are in real and dual")
        chosen = np.arange(np.prod(self.shape)).reshape(self.shape)[key]
        parts = (part.reshape(-1, 4)[chosen] for part in (self.real, self.dual))
        return self._of(*parts, unit=self._unit)

    def __iter__(self) -> Iterator[Self]:
        return (self[i] for i in range(len(self)))

    def inverse(self) -> Self:
        """Return the factor that makes 1: for a motion the motion back, the quaternion conjugate.

        Returns
        -------
        DualQuaternion
            The factor, on either side.

        Raises
        ------
        InputError
            If a real part is zero.
        """
        back = self.quaternion_conjugate()
        if self._unit:
            return back
        length = self.norm()
        square = 1.0 / (length * length)
        a, b = (np.asarray(part)[..., np.newaxis] for part in (square.real, square.dual))
        return self._of(back.real * a, back.dual * a + back.real * b, unit=False)

    def quaternion_conjugate(self) -> Self:
        """Return r* + eps s*, which reverses products.

        Returns
        -------
        DualQuaternion
            For a motion the motion back.
        """
        return self._of(conjugate(self.real), conjugate(self.dual), unit=self._unit)

    def dual_conjugate(self) -> Self:
        """Return r - eps s: the conjugate of eq. 53 for each component.

        Returns
        -------
        DualQuaternion
            The same rotation with the translation reversed.
        """
        return self._of(self.real.copy(), -self.dual, unit=self._unit)

    def combined_conjugate(self) -> Self:
        """Return r* - eps s*, the conjugate that moves points: q (1 + eps p) by it is 1 + eps (R p + t).

        Returns
        -------
        DualQuaternion
            Both conjugates, one after the other.
        """
        return self.quaternion_conjugate().dual_conjugate()

    def norm(self) -> DualNumber:
        """Norm as a dual number, the root of q times its quaternion conjugate: 1 + eps 0 for a motion.

        Returns
        -------
        DualNumber
            ``|r| + eps (r . s) / |r|``, of shape (...).

        Raises
        ------
        InputError
            If a real part is zero.
        """
        unit, perpendicular = _dual_parts.constraint_residuals(self.real, self.dual)
        return DualNumber(plain(unit + 1.0), plain(2.0 * perpendicular)).sqrt()

    def normalized(self) -> Self:
        """Divide by the norm: the motion that a sum or a multiple stands for.

        Returns
        -------
        DualQuaternion
            Of unit norm. The translation is that of ``2 s r* / |r|^2``: rounded numbers keep theirs.

        Raises
        ------
        InputError
            If a real part is zero or a number not finite: there is no direction to keep.

        Examples
        --------
        Linear blending of two motions:

        >>> from dqreg import DualQuaternion
        >>> a, b = DualQuaternion.identity(), DualQuaternion.from_screw([0, 0, 1], 1.0, 4.0)
        >>> (0.5 * a + 0.5 * b).normalized().as_screw().angle_rad
        0.5
        """
        # Divided by the largest component first, so that the squares neither overflow nor vanish.
        scale = np.max(np.abs(self.real), axis=-1, keepdims=True)
        if not np.all((scale > 0.0) & np.isfinite(scale)) or not np.isfinite(self.dual).all():
            raise InputError("a dual quaternion whose real part is zero, or not finite, cannot be normalized")
        real, dual = self.real / scale, self.dual / scale
        length = np.linalg.norm(real, axis=-1, keepdims=True)
        return self._of(*_dual_parts.onto_constraints(real / length, dual / length))

    def constraint_residuals(self) -> tuple[Any, Any]:
        """Say how far the two constraints are off: ``r . r - 1`` and ``r . s`` (eqs. 13-14).

        Returns
        -------
        tuple of float or ndarray
            Both zero up to rounding, (...); the second is a length.
        """
        unit, perpendicular = _dual_parts.constraint_residuals(self.real, self.dual)
        return plain(unit), plain(perpendicular)

    def canonical(self) -> Self:
        """Return, of q and -q, the same motion, the one whose first non-zero real component is positive.

        Returns
        -------
        DualQuaternion
        """
        sign = canonical_sign(self.real)[..., np.newaxis]
        parts = (sign * self.real + 0.0, sign * self.dual + 0.0)
        return self._of(*parts, unit=self._unit)
