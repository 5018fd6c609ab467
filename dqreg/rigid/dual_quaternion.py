"""Unit dual quaternions: a rigid motion as eight numbers, real + eps dual with eps^2 = 0.

Equation numbers: Walker, Shao and Volz (1991), who write the scalar last.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import as_float, as_pose, pose_of
from dqreg.rigid import _dual_parts, quaternion
from dqreg.rigid._dual_action import DualAction
from dqreg.rigid._matrices import of_rotations
from dqreg.rigid._operands import as_rigid_poses, require_meeting

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform


@dataclass(frozen=True, eq=False)
class DualQuaternion(DualAction):
    """A rigid motion as a unit dual quaternion, or a stack of them (eqs. 6-7).

    It maps source to target coordinates as ``T_target_source`` does: ``a * b`` is the motion b followed by a. Leading
    axes broadcast in every function, as those of `dqreg.quaternion` do; an index, ``len`` and a loop take a stack
    apart.

    ``q`` and ``-q`` are the same motion. ``==`` compares the numbers, so that q differs from -q; `isclose` compares
    motions. Between two motions ``**``, `power`, `sclerp` and `dqreg.quaternion.slerp` take the shorter rotation,
    whatever the signs; at exactly half a turn the axis whose first non-zero component is positive.

    Parts that break the constraints (13)-(14) are refused by the constructor, not mended; see `from_array`. What this
    class computes keeps them to rounding, however long a product grows. A sum ``a + b`` and a multiple ``2 * a`` are no
    motions until they are `normalized`.

    Parameters
    ----------
    real : array_like, (..., 4)
        Unit quaternions of the rotation, scalar first (eq. 11).
    dual : array_like, (..., 4)
        Half the translation, as a quaternion (0, t), times ``real`` (eq. 25); perpendicular to ``real``.

    Attributes
    ----------
    is_unit : bool
        Whether all of them are motions; False for a sum.
    shape : tuple of int
        Leading axes: () for a single one.

    Raises
    ------
    InputError
        If a part does not hold four numbers, ``real`` is not of norm 1, or ``dual`` is not perpendicular to it.
        The methods raise it where a shape is wrong, a number not finite, a matrix no rigid pose, an axis zero, or a
        motion is meant and a sum given.

    Examples
    --------
    A half-turn about the line through (1, 0, 0) along z:

    >>> q = DualQuaternion([0, 0, 0, 1], [0, 0, -1, 0])
    >>> q.apply([[0, 0, 0], [1, 0, 5]]).tolist()
    [[2.0, 0.0, 0.0], [1.0, 0.0, 5.0]]
    >>> q.as_array().tolist()
    [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0]
    >>> (2 * q).norm(), (q * q.inverse()).constraint_residuals()
    (DualNumber(real=2.0, dual=0.0), (0.0, 0.0))
    >>> (-q).canonical() == q, q.quaternion_conjugate() == q.inverse()
    (True, True)
    >>> q.combined_conjugate() == q.quaternion_conjugate().dual_conjugate()
    True
    """

    @classmethod
    def identity(cls, shape: tuple[int, ...] = ()) -> DualQuaternion:
        """Return the motion that leaves everything in place.

        Parameters
        ----------
        shape : tuple of int
            Leading axes; none for a single one.

        Returns
        -------
        DualQuaternion
            1 + eps 0.

        Examples
        --------
        >>> DualQuaternion.identity((2,)).as_array().tolist()
        [[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
        """
        return cls._of(np.tile([1.0, 0.0, 0.0, 0.0], (*shape, 1)), np.zeros((*shape, 4)))

    @classmethod
    def from_matrix(cls, T_target_source: ArrayLike | RigidTransform) -> DualQuaternion:
        """Read 4x4 poses (eqs. 21-25).

        Parameters
        ----------
        T_target_source : array_like, (..., 4, 4), or scipy.spatial.transform.RigidTransform
            Rigid poses. A SciPy ``Rotation`` will do as well.

        Returns
        -------
        DualQuaternion
            The same motions, in canonical sign.

        Raises
        ------
        InputError
            If a pose is not (4, 4) or (3, 4), not finite, or not rigid: off by more than 0.01, or a mirror image.

        Examples
        --------
        >>> T = np.eye(4)
        >>> T[:3, 3] = 1, 2, 3
        >>> DualQuaternion.from_matrix(T).dual.tolist()
        [0.0, 0.5, 1.0, 1.5]
        """
        T = as_float(pose_of(T_target_source), "T_target_source")
        single = T.ndim == 2
        T = as_pose(T, "T_target_source") if single else as_rigid_poses(T, "T_target_source")
        return cls._of(*_dual_parts.with_translation(of_rotations(T[..., :3, :3]), T[..., :3, 3]))

    @classmethod
    def from_screw(
        cls, axis: ArrayLike, angle: ArrayLike, distance: ArrayLike = 0.0, point: ArrayLike = (0.0, 0.0, 0.0)
    ) -> DualQuaternion:
        """Rotation about a line and translation along it (eqs. 8-12).

        Parameters
        ----------
        axis : array_like, (..., 3)
            Direction of the line; only the direction counts.
        angle : array_like, (...)
            Right-handed angle in radians.
        distance : array_like, (...)
            Translation along the axis.
        point : array_like, (..., 3)
            Any point on the line.

        Returns
        -------
        DualQuaternion
            The screw motions.

        Raises
        ------
        InputError
            If an axis is zero or not finite, or another number not finite.
        ValueError
            If leading axes do not broadcast.

        Examples
        --------
        >>> q = DualQuaternion.from_screw([0, 0, 1], np.pi, 3.0, [1, 0, 0])
        >>> q.translation.round(12).tolist()
        [2.0, -0.0, 3.0]
        """
        return cls._of(*_dual_parts.onto_constraints(*_dual_parts.from_screw(axis, angle, distance, point)))

    @classmethod
    def exp(cls, twist: ArrayLike) -> DualQuaternion:
        """Exponential of a twist, the same six numbers as in `dqreg.rigid.pose.exp`.

        Parameters
        ----------
        twist : array_like, (..., 6)
            Rotation vector w in radians, then translation part v. As a pure dual quaternion the argument is
            ``(0, w/2) + eps (0, v/2)``.

        Returns
        -------
        DualQuaternion
            The screw motions.

        Raises
        ------
        InputError
            If the twist does not hold six finite numbers in the last axis.

        Examples
        --------
        >>> DualQuaternion.exp([0, 0, np.pi, 2, 0, 0]).as_screw().point.round(3).tolist()
        [0.0, 0.637, 0.0]
        """
        return cls._of(*_dual_parts.exp(twist))

    def power(self, exponent: ArrayLike, *, shorter_turn: bool = True) -> DualQuaternion:
        """Real power: the same screw, angle and distance times the exponent. ``q ** exponent`` is the same.

        Parameters
        ----------
        exponent : array_like, (...)
            Real exponents; they broadcast against the stack.
        shorter_turn : bool
            Whether the rotation is the smaller of the two that q and -q stand for; otherwise that of the sign given.

        Returns
        -------
        DualQuaternion
            ``exp(exponent * log(q))``.

        Raises
        ------
        InputError
            If an exponent is not finite, they do not broadcast, or it is no motion but a sum.

        Examples
        --------
        >>> DualQuaternion.from_screw([0, 0, 1], 1.0, 4.0).power([0.25, 0.5]).as_screw().distance.round(12).tolist()
        [1.0, 2.0]
        """
        rho = as_float(exponent, "exponent")
        require_meeting(exponents=rho.shape, motions=self.shape)
        return DualQuaternion.exp(rho[..., np.newaxis] * _dual_parts.log(self._motion().real, self.dual, shorter_turn))

    def __pow__(self, exponent: ArrayLike) -> DualQuaternion:
        return self.power(exponent)

    def sclerp(self, other: DualQuaternion, fraction: ArrayLike, *, shorter_turn: bool = True) -> DualQuaternion:
        """Interpolate along one screw, at constant speed.

        Parameters
        ----------
        other : DualQuaternion
            Where fraction 1 ends.
        fraction : array_like, (...)
            0 at this motion, 1 at ``other``; values outside continue the screw. They broadcast against the stacks.
        shorter_turn : bool
            Whether to take the smaller rotation, whatever the signs; otherwise that of the signs given.

        Returns
        -------
        DualQuaternion
            ``self * (self^-1 * other) ** fraction``.

        Raises
        ------
        InputError
            If a fraction is not finite, the shapes do not broadcast, or one is no motion but a sum.

        Examples
        --------
        >>> end = DualQuaternion.from_screw([0, 0, 1], 1.0, 4.0)
        >>> DualQuaternion.identity().sclerp(end, [0.25, 0.5]).as_screw().distance.round(12).tolist()
        [1.0, 2.0]
        """
        return self._motion() * (self.inverse() * other._motion()).power(fraction, shorter_turn=shorter_turn)

    def isclose(self, other: DualQuaternion, *, angle_rad: float = 1e-9, distance: float | None = None) -> Any:
        """Say whether motions agree, whatever their signs.

        Parameters
        ----------
        other : DualQuaternion
            To compare with.
        angle_rad : float
            Largest angle between the two rotations.
        distance : float, optional
            Largest distance between the two translations; 1e-9 of the larger of them if not given.

        Returns
        -------
        bool or ndarray of bool, (...)
            One for each pair.

        Raises
        ------
        InputError
            If the shapes do not broadcast, or one is no motion but a sum.

        Examples
        --------
        >>> q = DualQuaternion.from_screw([0, 0, 1], 1.0, 4.0)
        >>> q.isclose(-q), q == -q
        (True, False)
        """
        require_meeting(left=self.shape, right=other.shape)
        step = quaternion.multiply(quaternion.conjugate(self._motion().real), other._motion().real)
        apart = 2.0 * np.arctan2(np.linalg.norm(step[..., 1:], axis=-1), np.abs(step[..., 0]))
        here, there = self.translation, other.translation
        if distance is None:
            limit = 1e-9 * np.maximum(np.linalg.norm(here, axis=-1), np.linalg.norm(there, axis=-1))
        else:
            limit = np.asarray(distance)
        close = (apart <= angle_rad) & (np.linalg.norm(here - there, axis=-1) <= limit)
        return close if close.ndim else bool(close)
