"""A trajectory: poses at times, and what lies between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, IntArray, as_float, require_finite
from dqreg._records import one_line
from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.rigid._operands import as_rigid_poses

Method = Literal["screw", "cubic"]
METHODS = ("screw", "cubic")


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of a moving body at times, T_world_body.

    Between two poses the body moves along one screw at constant velocity (``"screw"``: ScLERP), or along a cubic
    Hermite curve (``"cubic"``), ``T_i exp(phi(t))`` with a cubic phi, whose velocity has no jumps: at each pose it is
    that of the parabola through the pose and its two neighbours. The rotation between neighbours is the shorter one.

    Parameters
    ----------
    times : array_like, (n,)
        Increasing.
    poses : array_like, (n, 4, 4), or scipy.spatial.transform.RigidTransform
        Rigid poses, body to world.

    Raises
    ------
    InputError
        If there is none, the numbers differ, the times do not increase, or a pose is not rigid; in the methods also if
        a time lies outside.

    Examples
    --------
    >>> path = Trajectory([0, 1, 3], pose.exp([[0, 0, 0, 0, 0, 0], [0, 0, 0.2, 1, 0, 0], [0, 0, 0.6, 3, 0, 0]]))
    >>> path.at(2.0)[:2, 3].round(3).tolist()
    [1.947, 0.395]
    >>> path.velocities(2.0)[2:4].round(3).tolist()
    [0.2, 1.0]
    """

    __repr__ = one_line
    times: FloatArray
    poses: FloatArray

    def __post_init__(self) -> None:
        times, poses = as_float(self.times, "times"), as_rigid_poses(self.poses, "poses")
        if times.ndim != 1 or not len(times) or poses.shape != (len(times), 4, 4):
            raise InputError(
                f"times and poses must be (n,) and (n, 4, 4) with n > 0; got {times.shape} and {poses.shape}"
            )
        require_finite(times, "times")
        if not np.all(np.diff(times) > 0.0):
            bad = int(np.argmin(np.diff(times)))
            raise InputError(f"times must increase; times[{bad}] is {times[bad]:g} and the next {times[bad + 1]:g}")
        for name, value in (("times", times.copy()), ("poses", poses)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def length(self) -> float:
        """Sum of the distances between neighbouring positions, in the unit of the poses."""
        return float(np.linalg.norm(np.diff(self.poses[:, :3, 3], axis=0), axis=1).sum())

    def at(self, times: ArrayLike, *, method: Method = "screw") -> FloatArray:
        """Poses at any times within.

        Parameters
        ----------
        times : array_like, (...)
            Times from the first to the last.
        method : {"screw", "cubic"}
            Curve between the poses.

        Returns
        -------
        ndarray, (..., 4, 4)
            T_world_body.

        Raises
        ------
        InputError
            If a time lies outside, or the method is no known word.

        Examples
        --------
        >>> path = Trajectory([0, 2], pose.exp([[0, 0, 0, 0, 0, 0], [0, 0, 1, 4, 0, 0]]))
        >>> pose.log(path.at(0.5))[2:4].round(12).tolist()
        [0.25, 1.0]
        """
        i, s, _ = self._places(times)
        if len(self) == 1:
            return self.poses[i]
        curve, _ = self._curve(i, s, method)
        return np.asarray(self.poses[i] @ pose.exp(curve))

    def velocities(
        self, times: ArrayLike | None = None, *, frame: Literal["body", "world"] = "body", method: Method = "screw"
    ) -> FloatArray:
        """Velocities of the body, as twists.

        Parameters
        ----------
        times : array_like, (...), optional
            Times from the first to the last; those of the poses if not given. Where a screw ends and the next begins:
            that of the later one.
        frame : {"body", "world"}
            ``"body"``: angular velocity and velocity of the body's origin along the body's axes. ``"world"``: the
            twist x of ``T(t + dt) = exp(x dt) T(t)``, whose last three numbers are the velocity of the body's point
            that passes the world's origin.
        method : {"screw", "cubic"}
            Curve between the poses.

        Returns
        -------
        ndarray, (..., 6)
            Angular velocity in radians, then velocity, per unit of time.

        Raises
        ------
        InputError
            If a time lies outside, there is one pose only, or ``frame`` or ``method`` is no known word.

        Examples
        --------
        >>> path = Trajectory([0, 2], pose.exp([[0, 0, 0, 0, 0, 0], [0, 0, 1, 4, 0, 0]]))
        >>> path.velocities(0.5)[2:4].round(12).tolist()
        [0.5, 2.0]
        """
        if frame not in ("body", "world"):
            raise InputError(f'frame must be "body" or "world"; got {frame!r}')
        if len(self) == 1:
            raise InputError("a single pose has no velocity; give at least two")
        i, s, h = self._places(self.times if times is None else times)
        curve, slope = self._curve(i, s, method)
        # The velocity of exp(phi) in the moving frame is the right Jacobian at phi, the left one at -phi, times phi'.
        body = np.einsum("...ij,...j->...i", pose.left_jacobian(-curve), slope) / h[..., np.newaxis]
        if frame == "body":
            return np.asarray(body)
        here = self.poses[i] @ pose.exp(curve)
        return np.asarray(np.einsum("...ij,...j->...i", pose.adjoint(here), body))

    def resample(self, times: ArrayLike, *, method: Method = "screw") -> Trajectory:
        """Trajectory at other times.

        Parameters
        ----------
        times : array_like, (m,)
            Increasing times from the first to the last.
        method : {"screw", "cubic"}
            Curve between the poses.

        Returns
        -------
        Trajectory
            Of m poses.

        Raises
        ------
        InputError
            If the times do not increase, or one lies outside; if the method is no known word.

        Examples
        --------
        >>> path = Trajectory([0, 2], pose.exp([[0, 0, 0, 0, 0, 0], [0, 0, 0, 4, 0, 0]]))
        >>> path.resample([0, 0.5, 1]).poses[:, 0, 3].tolist()
        [0.0, 1.0, 2.0]
        """
        return Trajectory(as_float(times, "times"), self.at(times, method=method))

    def relative(self, step: int = 1) -> FloatArray:
        """Motions of the body over a number of poses, each in the body's frame before it.

        Parameters
        ----------
        step : int
            How many poses further.

        Returns
        -------
        ndarray, (n - step, 4, 4)
            ``poses[i]^-1 @ poses[i + step]``; the same whatever the world frame.

        Raises
        ------
        InputError
            If the step is not at least 1.

        Examples
        --------
        >>> path = Trajectory([0, 1, 2], pose.exp([[0, 0, 0, x, 0, 0] for x in (0, 1, 4)]))
        >>> path.relative()[:, 0, 3].tolist(), path.relative(2)[:, 0, 3].tolist()
        ([1.0, 3.0], [4.0])
        """
        if step < 1:
            raise InputError(f"step must be at least 1; got {step}")
        return np.asarray(pose.inverse(self.poses[:-step]) @ self.poses[step:])

    def moved(self, T_new_world: ArrayLike) -> Trajectory:
        """Trajectory in another world frame.

        Parameters
        ----------
        T_new_world : array_like, (4, 4)
            Pose of the old world frame in the new one; ``pose.inverse(poses[0])`` lets it begin at the identity.

        Returns
        -------
        Trajectory
            ``T_new_world @ poses``.

        Raises
        ------
        InputError
            If the pose is not (4, 4) or (3, 4), or not rigid.

        Examples
        --------
        >>> path = Trajectory([0, 1], pose.exp([[0, 0, 0, 7, 0, 0], [0, 0, 0, 9, 0, 0]]))
        >>> path.moved(pose.inverse(path.poses[0])).poses[:, 0, 3].tolist()
        [0.0, 2.0]
        """
        return Trajectory(self.times, as_rigid_poses(T_new_world, "T_new_world") @ self.poses)

    @cached_property
    def _screws(self) -> FloatArray:
        """Twist from each pose to the next, in its own frame, (n - 1, 6)."""
        return pose.log(self.relative())

    def _places(self, times: ArrayLike) -> tuple[IntArray, FloatArray, FloatArray]:
        """Interval of each time, the fraction of it that has passed, and its duration."""
        t = as_float(times, "times")
        if not np.all((t >= self.times[0]) & (t <= self.times[-1])):
            raise InputError(f"times must lie from {self.times[0]:g} to {self.times[-1]:g}, where there are poses")
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, max(len(self) - 2, 0))
        h = np.append(np.diff(self.times), 1.0)[i]
        return i, np.asarray((t - self.times[i]) / h), h

    def _curve(self, i: IntArray, s: FloatArray, method: Method) -> tuple[FloatArray, FloatArray]:
        """Twist from pose i, and its derivative by the fraction, (..., 6) each."""
        if method not in METHODS:
            raise InputError(f"method must be one of {METHODS}; got {method!r}")
        x, s = self._screws[i], s[..., np.newaxis]
        if method == "screw":
            return s * x, x
        h = np.diff(self.times)
        v = _knot_velocities(self._screws, h)
        begin = h[i, np.newaxis] * v[i]
        end = h[i, np.newaxis] * np.einsum("...ij,...j->...i", pose.left_jacobian_inverse(-x), v[i + 1])
        curve = s * (1 - s) ** 2 * begin + s * s * (3 - 2 * s) * x + s * s * (s - 1) * end
        slope = (1 - s) * (1 - 3 * s) * begin + 6 * s * (1 - s) * x + s * (3 * s - 2) * end
        return curve, slope


def _knot_velocities(screws: FloatArray, h: FloatArray) -> FloatArray:
    """Body velocity at each pose, of second order. Shapes: screws (n - 1, 6), h (n - 1,), returns (n, 6)."""
    mean = screws / h[:, np.newaxis]
    if len(mean) == 1:
        return np.repeat(mean, 2, axis=0)
    before, after = h[:-1, np.newaxis], h[1:, np.newaxis]
    inner = (after * mean[:-1] + before * mean[1:]) / (before + after)
    # The parabola through the first, and the last, three poses.
    first = mean[0] + (mean[0] - mean[1]) * h[0] / (h[0] + h[1])
    last = mean[-1] + (mean[-1] - mean[-2]) * h[-1] / (h[-1] + h[-2])
    return np.concatenate([first[np.newaxis], inner, last[np.newaxis]])
