"""A pose with its covariance, and both as filters, pose graphs and messages want them."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_vectors
from dqreg.errors import InputError
from dqreg.files.cloud_data import finite_rows
from dqreg.rigid import DualQuaternion, pose
from dqreg.rigid.twist import TRANSLATION_FIRST, scaling_by
from dqreg.trust.covariance import TOUCHED
from dqreg.trust.records import Direction, Verdict

Frame = Literal["source", "target", "centre"]
Order = Literal["rt", "tr"]
Side = Literal["left", "right"]

# An eigenvalue of a correlation matrix below this is zero: that motion was locked.
LOCKED = 1e-13


class UncertainPose:
    """What a `Registration` offers of its pose alone."""

    T_target_source: FloatArray
    verdict: Verdict
    covariance: FloatArray
    partial_information: FloatArray | None
    observability: tuple[Direction, ...]
    settings: dict[str, Any]

    @property
    def scale(self) -> float:
        """What source lengths were multiplied with, conversion of units included: ``p_target = R (scale p) + t``."""
        return float(self.settings.get("source_scale", 1.0))

    @property
    def dual_quaternion(self) -> DualQuaternion:
        """The pose as a unit dual quaternion; raises `InputError` where no pose was found."""
        return DualQuaternion.from_matrix(self._found())

    def apply(self, points: ArrayLike) -> FloatArray:
        """Move points of the source into the target frame.

        Parameters
        ----------
        points : array_like, (..., 3)
            Source coordinates, in the source's own unit: usually (n, 3), also one point or an image of points.

        Returns
        -------
        ndarray, (..., 3)
            Target coordinates, in the target's unit. A point with a coordinate that is NaN or infinite, which
            `register` leaves out, is NaN in all three: rows and pixels keep their places.

        Raises
        ------
        InputError
            If the points are not (..., 3), or no pose was found.

        Examples
        --------
        >>> from dqreg.geometry import Mesh
        >>> from dqreg.registration.register import register
        >>> from dqreg.synth.parts import bracket
        >>> part = Mesh(*bracket())
        >>> result = register(Mesh(part.vertices + [1, 0, 0], part.faces), part, "identity", effort="fast")
        >>> (result.apply([[1, 2, 3], [np.nan, 0, 0]]).round(6) + 0.0).tolist()
        [[0.0, 2.0, 3.0], [nan, nan, nan]]
        >>> bool(np.allclose(result.inverse() @ result.T_target_source, np.eye(4)))
        True
        """
        array = as_float(points, "points")
        rows = as_vectors(array.reshape(-1, 3) if array.shape[-1:] == (3,) else array, "points", finite=False)
        is_finite = finite_rows(rows)
        if not is_finite.all():
            rows = np.where(is_finite[:, None], rows, np.nan)
        return pose.apply(self._found(), rows * self.scale).reshape(array.shape)

    def inverse(self) -> FloatArray:
        """The pose T_source_target, (4, 4), from target coordinates to source coordinates (in target units).

        Returns
        -------
        ndarray, (4, 4)
            Inverse pose.

        Raises
        ------
        InputError
            If no pose was found.

        Examples
        --------
        >>> from dqreg.geometry import Mesh
        >>> from dqreg.registration.register import register
        >>> from dqreg.synth.parts import bracket
        >>> part = Mesh(*bracket())
        >>> result = register(Mesh(part.vertices + [1, 0, 0], part.faces), part, "identity", effort="fast")
        >>> (result.inverse()[:3, 3].round(6) + 0.0).tolist()
        [1.0, 0.0, 0.0]
        """
        return pose.inverse(self._found())

    @property
    def information(self) -> FloatArray:
        """Inverse of `covariance`, (6, 6), in the same frame: 0 along motions that are free.

        Raises `InputError` where no pose was found, and where motions are known exactly: ``dof=`` locked them, or it is
        the first frame of an `Odometry`, which defines the map's frame (code "first_frame").
        """
        self._found()
        if "first_frame" in self.verdict.codes:
            raise InputError(
                "the first frame defines the map's frame: its pose is exact and its information infinite. In a pose "
                'graph it is the pose that is held fixed; skip the frame whose verdict has the code "first_frame"'
            )
        known = self.partial_information
        return _inverse(self.covariance) if known is None else known.copy()

    def covariance_in(self, frame: Frame, *, order: Order = "rt", side: Side | None = None) -> FloatArray:
        """Covariance of the pose in the convention of another program.

        GTSAM, and Open3D's pose graphs: ``covariance_in("source")``. ROS, ``PoseWithCovariance`` of the source in the
        target: ``covariance_in("source", order="tr", side="left")``. Files of g2o as GTSAM reads them:
        ``covariance_in("source", order="tr")``; g2o itself counts half angles, which halves the rotations' rows and
        columns.

        Parameters
        ----------
        frame : {"source", "target", "centre"}
            Where the rotations' axes pass: through the origin of the source (at its pose), that of the target, or
            the centre of the target's bounding box.
        order : {"rt", "tr"}
            Which half of the six numbers comes first: the rotation vector or the translation.
        side : {"left", "right"}, optional
            Along which axes: those of the target ("left", ``T_true = exp(x) T`` for the frame "target") or of the
            source ("right", ``T_true = T exp(x)`` for the frame "source"). Default: right for the frame "source".

        Returns
        -------
        ndarray, (6, 6)
            rad^2 and squared target units; NaN in the rows and columns that a free motion takes part in.

        Raises
        ------
        InputError
            If no pose was found, or ``frame``, ``order`` or ``side`` is no known word.

        Examples
        --------
        >>> from dqreg.geometry import Mesh
        >>> from dqreg.registration.register import register
        >>> from dqreg.synth.parts import bracket
        >>> part = Mesh(*bracket())
        >>> result = register(part, part, "identity", effort="fast")
        >>> bool(np.allclose(result.covariance_in("centre"), result.covariance))
        True
        """
        J, rows = self._change(frame, side), _rows(order)
        found = J @ self.covariance @ J.T if np.isfinite(self.covariance).all() else self._with_free_motions(J)
        return np.asarray(found[np.ix_(rows, rows)])

    def information_in(self, frame: Frame, *, order: Order = "rt", side: Side | None = None) -> FloatArray:
        """Inverse of `covariance_in` of the same arguments, 0 along motions that are free.

        Parameters
        ----------
        frame : {"source", "target", "centre"}
            Where the rotations' axes pass.
        order : {"rt", "tr"}
            Which half comes first.
        side : {"left", "right"}, optional
            Along which axes.

        Returns
        -------
        ndarray, (6, 6)
            rad^-2 and squared inverse target units.

        Raises
        ------
        InputError
            If no pose was found, motions are known exactly (``dof=`` locked them), or a word is not known.

        Examples
        --------
        >>> from dqreg.geometry import Mesh
        >>> from dqreg.registration.register import register
        >>> from dqreg.synth.parts import bracket
        >>> part = Mesh(*bracket())
        >>> result = register(part, part, "identity", effort="fast")
        >>> bool(np.allclose(result.information_in("centre"), result.information))
        True
        """
        back, rows = np.linalg.inv(self._change(frame, side)), _rows(order)
        return np.asarray((back.T @ self.information @ back)[np.ix_(rows, rows)])

    def _change(self, frame: Frame, side: Side | None) -> FloatArray:
        """Matrix (6, 6) that carries twists from the frame of the covariance to another."""
        T, centre = self._found(), np.asarray(self.settings.get("centre", np.zeros(3)), dtype=np.float64)
        places = {"source": T[:3, 3], "target": np.zeros(3), "centre": centre}
        if not isinstance(frame, str) or frame not in places:
            raise InputError(f'frame must be "source", "target" or "centre"; got {frame!r:.60}')
        if side is None:
            side = "right" if frame == "source" else "left"
        if side not in ("left", "right"):
            raise InputError(f'side must be "left" (axes of the target) or "right" (of the source); got {side!r:.60}')
        # The difference of two places first: far from the origin, large numbers cancel once.
        R = T[:3, :3] if side == "right" else np.eye(3)
        return pose.adjoint(pose.from_parts(R.T, R.T @ (centre - places[frame])))

    def _with_free_motions(self, J: FloatArray) -> FloatArray:
        if self.partial_information is None:
            held = np.isfinite(np.diag(self.covariance))
            found = J @ np.where(held[:, None] & held, self.covariance, 0.0) @ J.T
            touched = (np.abs(J[:, ~held]) > 0.0).any(axis=1)
        else:
            # In displacements on the part, so that rotations and translations compare.
            turns, shifts = np.diag(self.partial_information).reshape(2, 3).sum(axis=1)
            size = scaling_by(np.sqrt(turns / shifts) if turns > 0.0 < shifts else 1.0)
            values, vectors = np.linalg.eigh(self.partial_information / size[:, None] / size)
            count = sum(direction.is_free for direction in self.observability)
            half = vectors[:, count:] / np.sqrt(values[count:]) / size[:, None]
            found = (J @ half) @ (J @ half).T
            free = J @ (vectors[:, :count] / size[:, None]) * size[:, None]
            touched = (np.abs(free) > TOUCHED).any(axis=1)
        found[touched] = np.nan
        found[:, touched] = np.nan
        return found

    def _found(self) -> FloatArray:
        if not np.isfinite(self.T_target_source).all():
            raise InputError(f"this registration found no pose: {'; '.join(self.verdict.reasons)}")
        return self.T_target_source


def _rows(order: Order) -> Any:
    if order not in ("rt", "tr"):
        raise InputError(f'order must be "rt" (rotation first) or "tr" (translation first); got {order!r:.60}')
    return TRANSLATION_FIRST if order == "tr" else np.arange(6)


def _inverse(covariance: FloatArray) -> FloatArray:
    """Inverse on the rows that are no NaN, 0 elsewhere."""
    held = np.isfinite(np.diag(covariance))
    block = covariance[np.ix_(held, held)]
    scale = np.sqrt(np.diag(block))
    scale[scale == 0.0] = 1.0
    # Squares of radians and of millimetres lie far apart.
    values, vectors = np.linalg.eigh(block / np.outer(scale, scale))
    if not (values > LOCKED).all():
        raise InputError(
            "motions of this pose are known exactly (locked by dof=, or set by definition): their information is "
            "infinite. Take covariance or covariance_in, which are 0 along them"
        )
    half = vectors / np.sqrt(values) / scale[:, None]
    found = np.zeros((6, 6))
    found[np.ix_(held, held)] = half @ half.T
    return found
