"""Unit dual quaternions: a rigid motion as eight numbers, real + eps dual with eps^2 = 0.

Equation numbers: Walker, Shao and Volz (1991), who write the scalar last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_pose, require_finite
from dqreg.errors import InputError
from dqreg.rigid import pose, quaternion_algebra, quaternion_matrices, quaternion_powers, screw
from dqreg.rigid.screw import DualNumber
from dqreg.rigid.twist import left_jacobian, left_jacobian_inverse

# Far above the rounding of one operation, far below anything a careless caller gives.
UNIT_TOLERANCE = 1e-9
# Below it floating point has no relative precision to hold anyone to.
_SMALLEST = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, eq=False)
class DualQuaternion:
    """A rigid motion as a unit dual quaternion (eqs. 6-7).

    It maps source to target coordinates as ``T_target_source`` does: ``a * b`` is the motion b followed by a.
    ``q`` and ``-q`` are the same motion; compare `canonical` forms. Parts that break the constraints
    (13)-(14) are refused, not mended; what this class computes keeps them to rounding, however long a product
    grows.

    Parameters
    ----------
    real : array_like, (4,)
        Unit quaternion of the rotation, scalar first (eq. 11).
    dual : array_like, (4,)
        Half the translation, as a quaternion (0, t), times ``real`` (eq. 25); perpendicular to ``real``.

    Raises
    ------
    InputError
        If a part does not hold four numbers, ``real`` is not of norm 1 (zero and NaN are not), or ``dual`` is
        not perpendicular to it.

    Examples
    --------
    A half-turn about the line through (1, 0, 0) along z:

    >>> q = DualQuaternion([0, 0, 0, 1], [0, 0, -1, 0])
    >>> q.apply([[0, 0, 0], [1, 0, 5]]).tolist()
    [[2.0, 0.0, 0.0], [1.0, 0.0, 5.0]]
    """

    real: FloatArray
    dual: FloatArray

    def __post_init__(self) -> None:
        for name in ("real", "dual"):
            part = np.array(as_float(getattr(self, name), name))  # a copy, so that it can be locked
            if part.shape != (4,):
                raise InputError(f"{name} must hold one quaternion w, x, y, z; got shape {part.shape}")
            part.flags.writeable = False
            object.__setattr__(self, name, part)
        unit_residual, perpendicular_residual = self.constraint_residuals()
        # Written so that NaN fails; the dual part is a length, so its tolerance is relative.
        if not abs(unit_residual) <= UNIT_TOLERANCE:
            raise InputError(
                f"the real part of a unit dual quaternion has norm 1; its square is off by {unit_residual:.3g} "
                f"(allowed {UNIT_TOLERANCE:g}). Divide both parts by the norm first if a scale is not meant"
            )
        largest = float(np.abs(self.dual).max())  # a norm would square numbers of 1e-160 away
        if not abs(perpendicular_residual) <= UNIT_TOLERANCE * largest + _SMALLEST:
            raise InputError(
                "the parts of a unit dual quaternion are perpendicular; their product is "
                f"{perpendicular_residual:.3g} for a dual part with components up to {largest:.3g}"
            )

    @classmethod
    def identity(cls) -> DualQuaternion:
        """Return the motion that leaves everything in place.

        Returns
        -------
        DualQuaternion
            1 + eps 0.

        Examples
        --------
        >>> DualQuaternion.identity().real.tolist()
        [1.0, 0.0, 0.0, 0.0]
        """
        return cls(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(4))

    @classmethod
    def from_matrix(cls, T_target_source: ArrayLike) -> DualQuaternion:
        """Read a 4x4 pose (eqs. 21-25).

        Parameters
        ----------
        T_target_source : array_like, (4, 4)
            Rigid pose.

        Returns
        -------
        DualQuaternion
            The same motion, in canonical sign.

        Raises
        ------
        InputError
            If the matrix is not a rigid pose.

        Examples
        --------
        >>> DualQuaternion.from_matrix(np.diag([-1, -1, 1, 1])).real.tolist()
        [0.0, 0.0, 0.0, 1.0]
        """
        T = as_pose(T_target_source, "T_target_source")
        return _with_translation(quaternion_matrices.from_matrix(T[:3, :3]), T[:3, 3])

    def as_matrix(self) -> FloatArray:
        """Write as a 4x4 pose (eqs. 1, 17-20).

        Returns
        -------
        ndarray, (4, 4)
            T_target_source.

        Examples
        --------
        >>> DualQuaternion([1, 0, 0, 0], [0, 0.5, 1, 1.5]).as_matrix()[:3, 3].tolist()
        [1.0, 2.0, 3.0]
        """
        return pose.from_parts(quaternion_matrices.to_matrix(self.real), self.translation)

    @property
    def translation(self) -> FloatArray:
        """Translation ``t = 2 (r4 s - s4 r + r x s)``, the vector part of 2 dual real* (eqs. 19-20, 61-69)."""
        product = quaternion_algebra.multiply(self.dual, quaternion_algebra.conjugate(self.real))
        return np.asarray(2.0 * product[1:])

    @classmethod
    def from_screw(
        cls, axis: ArrayLike, angle: float, distance: float = 0.0, point: ArrayLike = (0.0, 0.0, 0.0)
    ) -> DualQuaternion:
        """Turn about a line and shift along it (eqs. 8-12).

        Parameters
        ----------
        axis : array_like, (3,)
            Direction of the line; only the direction counts.
        angle : float
            Right-handed angle in radians.
        distance : float
            Shift along the axis.
        point : array_like, (3,)
            Any point on the line.

        Returns
        -------
        DualQuaternion
            The screw motion.

        Raises
        ------
        InputError
            If the axis is zero, a shape is wrong, or a number is not finite.

        Examples
        --------
        >>> q = DualQuaternion.from_screw([0, 0, 1], np.pi, 3.0, [1, 0, 0])
        >>> q.translation.round(12).tolist()
        [2.0, -0.0, 3.0]
        """
        return cls(*screw.screw_to_parts(axis, angle, distance, point))

    def as_screw(self) -> screw.Screw:
        """Read off the line, the turn about it and the shift along it (eqs. 70-75, corrected).

        Returns
        -------
        Screw
            Axis, angle in [0, pi], distance, and the point of the line nearest the origin. A pure translation
            has angle 0, its own direction as axis and the origin as point; the identity also has distance 0.

        Examples
        --------
        >>> DualQuaternion([1, 0, 0, 0], [0, 0, 0, 1.5]).as_screw().axis.tolist()
        [0.0, 0.0, 1.0]
        """
        return screw.screw_from_parts(self.real, self.dual)

    @classmethod
    def exp(cls, twist: ArrayLike) -> DualQuaternion:
        """Exponential of a twist, the same six numbers as in `dqreg.rigid.pose.exp`.

        Parameters
        ----------
        twist : array_like, (6,)
            Rotation vector w in radians, then translation part v. As a pure dual quaternion the argument is
            ``(0, w/2) + eps (0, v/2)``.

        Returns
        -------
        DualQuaternion
            The screw motion.

        Raises
        ------
        InputError
            If there are not six finite numbers.

        Examples
        --------
        >>> DualQuaternion.exp([0, 0, 0, 2, 4, 6]).dual.tolist()
        [0.0, 1.0, 2.0, 3.0]
        """
        numbers = as_float(twist, "twist")
        if numbers.shape != (6,):
            raise InputError(f"twist must hold six numbers, rotation first, then translation; got {numbers.shape}")
        require_finite(numbers, "twist")
        w, v = numbers[:3], numbers[3:]
        real = quaternion_powers.exp(np.concatenate([[0.0], w / 2.0]))
        return _with_translation(real, left_jacobian(w) @ v)

    def log(self) -> FloatArray:
        """Twist of the motion along its shorter turn: the inverse of `exp`.

        Returns
        -------
        ndarray, (6,)
            Rotation vector, at most pi long, then translation part. ``exp`` of it is the canonical form.

        Examples
        --------
        >>> DualQuaternion.exp([0.1, 0.2, 0.3, 4, 5, 6]).log().round(12).tolist()
        [0.1, 0.2, 0.3, 4.0, 5.0, 6.0]
        """
        w = 2.0 * quaternion_powers.log(quaternion_algebra.canonical(self.real))[1:]
        return np.concatenate([w, left_jacobian_inverse(w) @ self.translation])

    def __mul__(self, other: DualQuaternion) -> DualQuaternion:
        if not isinstance(other, DualQuaternion):
            return NotImplemented
        real = quaternion_algebra.multiply(self.real, other.real)
        left = quaternion_algebra.multiply(self.real, other.dual)
        return _rounded_off(real, left + quaternion_algebra.multiply(self.dual, other.real))

    def __pow__(self, exponent: float) -> DualQuaternion:
        return DualQuaternion.exp(float(exponent) * self.log())

    def sclerp(self, other: DualQuaternion, fraction: float) -> DualQuaternion:
        """Interpolate along one screw, at constant speed and by the shorter turn.

        Parameters
        ----------
        other : DualQuaternion
            Where fraction 1 ends.
        fraction : float
            0 at this motion, 1 at ``other``; values outside continue the screw.

        Returns
        -------
        DualQuaternion
            ``self * (self^-1 * other) ** fraction``.

        Examples
        --------
        >>> end = DualQuaternion.from_screw([0, 0, 1], 1.0, 4.0)
        >>> DualQuaternion.identity().sclerp(end, 0.25).as_screw().distance
        1.0
        """
        return self * (self.inverse() * other) ** fraction

    def inverse(self) -> DualQuaternion:
        """Return the motion back, which for a unit dual quaternion is the quaternion conjugate.

        Returns
        -------
        DualQuaternion
            The factor that makes the identity.

        Examples
        --------
        >>> DualQuaternion([1, 0, 0, 0], [0, 0, 0, 1]).inverse().dual.tolist()
        [0.0, 0.0, 0.0, -1.0]
        """
        back = self.quaternion_conjugate()
        return _rounded_off(back.real, back.dual)

    def quaternion_conjugate(self) -> DualQuaternion:
        """Return r* + eps s*, which reverses products.

        Returns
        -------
        DualQuaternion
            The motion back.

        Examples
        --------
        >>> DualQuaternion([0, 0, 0, 1], [0, 1, 0, 0]).quaternion_conjugate().real.tolist()
        [0.0, -0.0, -0.0, -1.0]
        """
        return DualQuaternion(*map(quaternion_algebra.conjugate, (self.real, self.dual)))

    def dual_conjugate(self) -> DualQuaternion:
        """Return r - eps s: the conjugate of eq. 53 for each component.

        Returns
        -------
        DualQuaternion
            The same rotation with the translation reversed.

        Examples
        --------
        >>> DualQuaternion([1, 0, 0, 0], [0, 0, 0, 1]).dual_conjugate().translation.tolist()
        [0.0, 0.0, -2.0]
        """
        return DualQuaternion(self.real, -self.dual)

    def combined_conjugate(self) -> DualQuaternion:
        """Return r* - eps s*, the conjugate that moves points: q (1 + eps p) by it is 1 + eps (R p + t).

        Returns
        -------
        DualQuaternion
            Both conjugates, one after the other.

        Examples
        --------
        >>> DualQuaternion([1, 0, 0, 0], [0, 0, 0, 1]).combined_conjugate().dual.tolist()
        [-0.0, 0.0, 0.0, 1.0]
        """
        return self.quaternion_conjugate().dual_conjugate()

    def norm(self) -> DualNumber:
        """Norm as a dual number, the root of q times its quaternion conjugate: 1 + eps 0 up to rounding.

        Returns
        -------
        DualNumber
            ``|r| + eps (r . s) / |r|``.

        Examples
        --------
        >>> DualQuaternion([0, 0, 0, 1], [0, 1, 0, 0]).norm()
        DualNumber(real=1.0, dual=0.0)
        """
        square = DualNumber(float(self.real @ self.real), 2.0 * float(self.real @ self.dual))
        return square.sqrt()

    def constraint_residuals(self) -> tuple[float, float]:
        """Say how far the two constraints are off: ``r . r - 1`` and ``r . s`` (eqs. 13-14).

        Returns
        -------
        tuple of float
            Both zero up to rounding; the second is a length.

        Examples
        --------
        >>> DualQuaternion([0, 0, 0, 1], [0, 1, 0, 0]).constraint_residuals()
        (0.0, 0.0)
        """
        return float(self.real @ self.real) - 1.0, float(self.real @ self.dual)

    def canonical(self) -> DualQuaternion:
        """Return, of q and -q, the one whose first non-zero real component is positive.

        Returns
        -------
        DualQuaternion
            The same motion.

        Examples
        --------
        >>> DualQuaternion([0, 0, 0, -1], [0, 1, 0, 0]).canonical().dual.tolist()
        [0.0, -1.0, 0.0, 0.0]
        """
        sign = quaternion_algebra.canonical_sign(self.real)
        return DualQuaternion(sign * self.real + 0.0, sign * self.dual + 0.0)

    def apply(self, points_source: ArrayLike) -> FloatArray:
        """Move points: R p + t (eqs. 28-29, in the Euclidean form).

        Parameters
        ----------
        points_source : array_like, (..., 3)
            Points, usually (n, 3).

        Returns
        -------
        ndarray, (..., 3)
            Points in the target frame.

        Raises
        ------
        InputError
            If the last axis does not hold three numbers.

        Examples
        --------
        >>> DualQuaternion([1, 0, 0, 0], [0, 0, 0, 1]).apply([[5, 6, 7]]).tolist()
        [[5.0, 6.0, 9.0]]
        """
        return pose.apply(self.as_matrix(), points_source)


def _with_translation(real: FloatArray, t: FloatArray) -> DualQuaternion:
    # Eq. 25: s = W(r) t with the translation quaternion (0, t) / 2.
    return _rounded_off(real, quaternion_algebra.multiply(np.concatenate([[0.0], t / 2.0]), real))


def _rounded_off(real: FloatArray, dual: FloatArray) -> DualQuaternion:
    # Our own results are put back on the constraints, so that rounding does not pile up in long products. The
    # translation does not feel the part of `dual` along `real`. The second pass serves duals that are all
    # rounding.
    real = real / np.linalg.norm(real)
    for _ in range(2):
        dual = dual - (real @ dual) * real
    return DualQuaternion(real, dual)
