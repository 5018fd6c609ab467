"""Unit dual quaternions: a rigid motion as eight numbers, real + eps dual with eps^2 = 0.

Equation numbers: Walker, Shao and Volz (1991), who write the scalar last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_pose
from dqreg.errors import InputError
from dqreg.rigid import _dual_parts, pose, quaternion
from dqreg.rigid._algebra import canonical_sign
from dqreg.rigid.rotations import left_jacobian_inverse
from dqreg.rigid.screw import DualNumber, Screw


@dataclass(frozen=True, eq=False)
class DualQuaternion:
    """A rigid motion as a unit dual quaternion (eqs. 6-7).

    It maps source to target coordinates as ``T_target_source`` does: ``a * b`` is the motion b followed by a.
    ``q`` and ``-q`` are the same motion; compare `canonical` forms. Parts that break the constraints (13)-(14)
    are refused, not mended; what this class computes keeps them to rounding, however long a product grows.

    Parameters
    ----------
    real : array_like, (4,)
        Unit quaternion of the rotation, scalar first (eq. 11).
    dual : array_like, (4,)
        Half the translation, as a quaternion (0, t), times ``real`` (eq. 25); perpendicular to ``real``.

    Raises
    ------
    InputError
        If a part does not hold four numbers, ``real`` is not of norm 1, or ``dual`` is not perpendicular to it.
        The methods raise it where a shape is wrong, a number not finite, a matrix no rigid pose, or an axis zero.

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
        _dual_parts.require_unit(self.real, self.dual)

    @classmethod
    def identity(cls) -> DualQuaternion:
        """Return the motion that leaves everything in place.

        Returns
        -------
        DualQuaternion
            1 + eps 0.
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
        """
        T = as_pose(T_target_source, "T_target_source")
        return cls(*_dual_parts.with_translation(quaternion.from_matrix(T[:3, :3]), T[:3, 3]))

    def as_matrix(self) -> FloatArray:
        """Write as a 4x4 pose (eqs. 1, 17-20).

        Returns
        -------
        ndarray, (4, 4)
            T_target_source.
        """
        return pose.from_parts(quaternion.to_matrix(self.real), self.translation)

    @property
    def translation(self) -> FloatArray:
        """Translation ``t = 2 (r4 s - s4 r + r x s)``, the vector part of 2 dual real* (eqs. 19-20, 61-69)."""
        product = quaternion.multiply(self.dual, quaternion.conjugate(self.real))
        return np.asarray(2.0 * product[1:])

    @classmethod
    def from_screw(
        cls, axis: ArrayLike, angle: float, distance: float = 0.0, point: ArrayLike = (0.0, 0.0, 0.0)
    ) -> DualQuaternion:
        """Rotation about a line and translation along it (eqs. 8-12).

        Parameters
        ----------
        axis : array_like, (3,)
            Direction of the line; only the direction counts.
        angle : float
            Right-handed angle in radians.
        distance : float
            Translation along the axis.
        point : array_like, (3,)
            Any point on the line.

        Returns
        -------
        DualQuaternion

        Examples
        --------
        >>> q = DualQuaternion.from_screw([0, 0, 1], np.pi, 3.0, [1, 0, 0])
        >>> q.translation.round(12).tolist()
        [2.0, -0.0, 3.0]
        """
        return cls(*_dual_parts.from_screw(axis, angle, distance, point))

    def as_screw(self) -> Screw:
        """Read off the line, the rotation about it and the translation along it (eqs. 70-75, corrected).

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
        return _dual_parts.as_screw(self.real, self.dual)

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
        """
        return cls(*_dual_parts.exp(twist))

    def log(self) -> FloatArray:
        """Twist of the smaller rotation: the inverse of `exp`.

        Returns
        -------
        ndarray, (6,)
            Rotation vector, at most pi long, then translation part. ``exp`` of it is the canonical form.

        Examples
        --------
        >>> DualQuaternion.exp([0.1, 0.2, 0.3, 4, 5, 6]).log().round(12).tolist()
        [0.1, 0.2, 0.3, 4.0, 5.0, 6.0]
        """
        w = 2.0 * quaternion.log(quaternion.canonical(self.real))[1:]
        return np.concatenate([w, left_jacobian_inverse(w) @ self.translation])

    def __mul__(self, other: DualQuaternion) -> DualQuaternion:
        if not isinstance(other, DualQuaternion):
            return NotImplemented
        return DualQuaternion(*_dual_parts.product((self.real, self.dual), (other.real, other.dual)))

    def __pow__(self, exponent: float) -> DualQuaternion:
        return DualQuaternion.exp(float(exponent) * self.log())

    def sclerp(self, other: DualQuaternion, fraction: float) -> DualQuaternion:
        """Interpolate along one screw, at constant speed and by the smaller rotation.

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
        """
        back = self.quaternion_conjugate()
        return DualQuaternion(*_dual_parts.onto_constraints(back.real, back.dual))

    def quaternion_conjugate(self) -> DualQuaternion:
        """Return r* + eps s*, which reverses products.

        Returns
        -------
        DualQuaternion
            The motion back.
        """
        return DualQuaternion(quaternion.conjugate(self.real), quaternion.conjugate(self.dual))

    def dual_conjugate(self) -> DualQuaternion:
        """Return r - eps s: the conjugate of eq. 53 for each component.

        Returns
        -------
        DualQuaternion
            The same rotation with the translation reversed.
        """
        return DualQuaternion(self.real, -self.dual)

    def combined_conjugate(self) -> DualQuaternion:
        """Return r* - eps s*, the conjugate that moves points: q (1 + eps p) by it is 1 + eps (R p + t).

        Returns
        -------
        DualQuaternion
            Both conjugates, one after the other.
        """
        return self.quaternion_conjugate().dual_conjugate()

    def norm(self) -> DualNumber:
        """Norm as a dual number, the root of q times its quaternion conjugate: 1 + eps 0 up to rounding.

        Returns
        -------
        DualNumber
            ``|r| + eps (r . s) / |r|``.
        """
        square = DualNumber(float(self.real @ self.real), 2.0 * float(self.real @ self.dual))
        return square.sqrt()

    def constraint_residuals(self) -> tuple[float, float]:
        """Say how far the two constraints are off: ``r . r - 1`` and ``r . s`` (eqs. 13-14).

        Returns
        -------
        tuple of float
            Both zero up to rounding; the second is a length.
        """
        return _dual_parts.constraint_residuals(self.real, self.dual)

    def canonical(self) -> DualQuaternion:
        """Return, of q and -q, the one whose first non-zero real component is positive.

        Returns
        -------
        DualQuaternion
        """
        sign = canonical_sign(self.real)
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
        """
        return pose.apply(self.as_matrix(), points_source)
