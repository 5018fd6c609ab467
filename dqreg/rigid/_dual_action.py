"""What unit dual quaternions do, as rigid motions, to points, directions, lines and planes.

Equation numbers: Walker, Shao and Volz (1991), who write the scalar last.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.rigid import _dual_parts, pose
from dqreg.rigid._dual_algebra import DualAlgebra
from dqreg.rigid._matrices import to_matrix
from dqreg.rigid._operands import as_lines, as_planes, as_triples, require_meeting
from dqreg.rigid._pose_action import shifted_lines, shifted_planes
from dqreg.rigid.screw import Screw

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform


@dataclass(frozen=True, eq=False)
class DualAction(DualAlgebra):
    """Unit dual quaternions at work."""

    def as_matrix(self) -> FloatArray:
        """Write as 4x4 poses (eqs. 1, 17-20).

        Returns
        -------
        ndarray, (..., 4, 4)
            T_target_source.

        Raises
        ------
        InputError
            If it is no motion but a sum or a multiple: see `normalized`.

        Examples
        --------
        >>> from dqreg import DualQuaternion
        >>> DualQuaternion([1, 0, 0, 0], [0, 0, 0, 1.5]).as_matrix()[:3].tolist()
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 3.0]]
        """
        return pose.from_parts(to_matrix(self._motion().real), self.translation)

    def as_rigid_transform(self) -> RigidTransform:
        """Write as SciPy's class; `from_matrix` reads it.

        Returns
        -------
        scipy.spatial.transform.RigidTransform
            The same motions.

        Raises
        ------
        MissingDependencyError
            If SciPy is older than 1.16.
        """
        return pose.to_rigid_transform(self.as_matrix())

    def as_screw(self) -> Screw:
        """Read off the line, the rotation about it and the translation along it (eqs. 70-75, corrected).

        Returns
        -------
        Screw
            Axis, angle in [0, pi], distance, and the point of the line nearest the origin. A pure translation
            has angle 0, its own direction as axis and the origin as point; the identity also has distance 0.

        Raises
        ------
        InputError
            If it is no motion but a sum or a multiple: see `normalized`.

        Examples
        --------
        >>> from dqreg import DualQuaternion
        >>> DualQuaternion([1, 0, 0, 0], [0, 0, 0, 1.5]).as_screw().axis.tolist()
        [0.0, 0.0, 1.0]
        """
        return _dual_parts.as_screw(self._motion().real, self.dual)

    def log(self) -> FloatArray:
        """Twist of the smaller rotation: the inverse of `exp`.

        Returns
        -------
        ndarray, (..., 6)
            Rotation vector, at most pi long, then translation part. ``exp`` of it is the canonical form.

        Raises
        ------
        InputError
            If it is no motion but a sum or a multiple: see `normalized`.

        Examples
        --------
        >>> from dqreg import DualQuaternion
        >>> DualQuaternion.exp([0.1, 0.2, 0.3, 4, 5, 6]).log().round(12).tolist()
        [0.1, 0.2, 0.3, 4.0, 5.0, 6.0]
        """
        return _dual_parts.log(self._motion().real, self.dual)

    @property
    def translation(self) -> FloatArray:
        """Translation ``t = 2 (r4 s - s4 r + r x s)``, (..., 3): the vector part of 2 dual real* (19-20, 61-69)."""
        return _dual_parts.translation(self._motion().real, self.dual)

    def apply(self, points_source: ArrayLike) -> FloatArray:
        """Move points: R p + t (eqs. 28-29, in the Euclidean form).

        Parameters
        ----------
        points_source : array_like, (..., 3)
            Points, usually (n, 3). One motion moves them all. The axes of a stack broadcast against the leading axes of
            the points: n motions move n points one by one, and ``motions[:, None]`` moves all points by each.

        Returns
        -------
        ndarray, (..., 3)
            Points in the target frame.

        Raises
        ------
        InputError
            If the points are not (..., 3), leading axes do not broadcast, or it is no motion but a sum.

        Examples
        --------
        >>> from dqreg import DualQuaternion
        >>> motions = DualQuaternion.exp([[0, 0, 0, 0, 0, 1], [0, 0, 0, 0, 0, 2]])
        >>> motions[:, None].apply([[1, 0, 0], [0, 1, 0]])[1].tolist()  # all points by the second
        [[1.0, 0.0, 2.0], [0.0, 1.0, 2.0]]
        """
        if not self.shape:
            return pose.apply(self.as_matrix(), points_source)
        points = as_triples(points_source, "points_source")
        require_meeting(motions=self.shape, points=points.shape[:-1])
        return _dual_parts.rotated(self._motion().real, points) + self.translation

    def rotate(self, directions_source: ArrayLike) -> FloatArray:
        """Rotate directions: R m, without the translation.

        Parameters
        ----------
        directions_source : array_like, (..., 3)
            Directions; they broadcast as points do in `apply`.

        Returns
        -------
        ndarray, (..., 3)
            Directions in the target frame.

        Raises
        ------
        InputError
            If the directions are not (..., 3), leading axes do not broadcast, or it is no motion but a sum.

        Examples
        --------
        >>> from dqreg import DualQuaternion
        >>> DualQuaternion([0, 0, 0, 1], [0, 0, -1, 0]).rotate([1, 2, 3]).tolist()  # a half-turn
        [-1.0, -2.0, 3.0]
        """
        directions = as_triples(directions_source, "directions_source")
        require_meeting(motions=self.shape, directions=directions.shape[:-1])
        return _dual_parts.rotated(self._motion().real, directions)

    def move_lines(self, lines_source: ArrayLike) -> FloatArray:
        """Move lines, as `dqreg.rigid.lines` writes them: the dual vectors n + eps m of eq. 9.

        Parameters
        ----------
        lines_source : array_like, (..., 6)
            Direction and moment of each line; they broadcast as points do in `apply`.

        Returns
        -------
        ndarray, (..., 6)
            Lines in the target frame.

        Raises
        ------
        InputError
            If the lines are not (..., 6), leading axes do not broadcast, or it is no motion but a sum.

        Examples
        --------
        >>> from dqreg import DualQuaternion
        >>> DualQuaternion([1, 0, 0, 0], [0, 0.5, 1, 1.5]).move_lines([0, 0, 1, 0, 0, 0]).tolist()  # by (1, 2, 3)
        [0.0, 0.0, 1.0, 2.0, -1.0, 0.0]
        """
        lines = as_lines(lines_source, "lines_source")
        return shifted_lines(self.rotate(lines[..., :3]), self.rotate(lines[..., 3:]), self.translation)

    def move_planes(self, planes_source: ArrayLike) -> FloatArray:
        """Move planes ``a x + b y + c z + d = 0``.

        Parameters
        ----------
        planes_source : array_like, (..., 4)
            Coefficients a, b, c, d of each plane; they broadcast as points do in `apply`.

        Returns
        -------
        ndarray, (..., 4)
            Planes in the target frame, with normals of the same length.

        Raises
        ------
        InputError
            If the planes are not (..., 4), leading axes do not broadcast, or it is no motion but a sum.

        Examples
        --------
        >>> from dqreg import DualQuaternion
        >>> DualQuaternion([1, 0, 0, 0], [0, 0.5, 1, 1.5]).move_planes([0, 0, 1, -10]).tolist()  # by (1, 2, 3)
        [0.0, 0.0, 1.0, -13.0]
        """
        planes = as_planes(planes_source, "planes_source")
        return shifted_planes(self.rotate(planes[..., :3]), planes[..., 3:], self.translation)

    def _motion(self) -> Self:
        """Itself, if it is one."""
        if not self._unit:
            if not _dual_parts.is_unit(self.real, self.dual):
                raise InputError("a sum or a multiple of dual quaternions is no rigid motion; call normalized() first")
            object.__setattr__(self, "_unit", True)
        return self
