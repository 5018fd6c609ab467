"""The degrees of freedom of a pose, in any frame; the others are locked exactly, not zeroed afterwards."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, as_pose, require_finite
from dqreg._records import one_line
from dqreg.errors import InputError
from dqreg.rigid import quaternion
from dqreg.solvers.dof_chart import Flags, FrameMotion, compose, relative, tangent
from dqreg.solvers.dof_words import WORDS, as_frame, flags, read_words


@dataclasses.dataclass(frozen=True, eq=False)
class Freedom:
    """The degrees of freedom of a pose relative to a reference pose, in a frame of the target's side.

    The motion is ``M = T @ inverse(T_reference)``. Six numbers describe it in the frame: ``rx, ry, rz``, its rotation
    vector along the frame's axes, and ``tx, ty, tz``, the translation of the frame's origin along them: it is a
    **rotation about the origin of the frame, then a translation**. A locked number is zero, the free ones are fitted.
    So the origin of the frame matters wherever a rotation is free: it is the centre of that rotation.

    Where the free motions form a group, this is that group: ``"rz"`` a turntable, ``"rz tz"`` a shaft in its bearing,
    ``"rz tx ty"`` a part on a table, ``"rx ry rz"`` a ball joint, ``"tx"`` a slide, ``"tx ty tz"`` a translation,
    ``"rz tx ty tz"`` what a levelled scanner needs. Other choices are no groups (the result of two allowed motions
    need not be allowed), and the definition still says what is meant: ``"rx ry"`` tilts about any axis in the xy
    plane and never twists about z.

    Made by `only`, `locked` or `parse`.

    Attributes
    ----------
    turns, shifts : tuple of bool
        Whether rotations about x, y, z and translations along them are free.
    frame : ndarray, (4, 4)
        T_target_frame: origin and axes of the frame, in the target's coordinates.

    Raises
    ------
    InputError
        By its methods, where a word is not known, a pose not rigid, a number not finite, or a locked one not zero.

    Examples
    --------
    >>> table = Freedom.only("rz", "tx", "ty")
    >>> str(table), str(Freedom.locked("rx", "ry", "tz"))
    ('rz tx ty', 'rz tx ty')
    >>> Freedom.parse("-rx -ry").count
    4
    >>> Freedom.only("rz", frame=[0, 0, 9]).brought_to(np.array([1, 2, 3])).frame[:3, 3].tolist()
    [0.0, 0.0, 3.0]
    """

    __repr__ = one_line
    turns: Flags
    shifts: Flags
    frame: FloatArray

    @classmethod
    def only(cls, *words: str, frame: ArrayLike | None = None) -> Freedom:
        """Only the degrees of freedom named are free.

        Parameters
        ----------
        *words : str
            Of rx, ry, rz, tx, ty, tz; r and t stand for three of them, all and none for what they say.
        frame : array_like, (4, 4) or (3,), optional
            T_target_frame, or its origin alone where its axes are the target's. Default: the target's own frame.

        Returns
        -------
        Freedom
        """
        rx, ry, rz, tx, ty, tz = flags(words)
        return cls((rx, ry, rz), (tx, ty, tz), as_frame(frame, "frame"))

    @classmethod
    def locked(cls, *words: str, frame: ArrayLike | None = None) -> Freedom:
        """All degrees of freedom but those named are free.

        Parameters
        ----------
        *words, frame
            As in `only`.

        Returns
        -------
        Freedom
        """
        rx, ry, rz, tx, ty, tz = (not named for named in flags(words))
        return cls((rx, ry, rz), (tx, ty, tz), as_frame(frame, "frame"))

    @classmethod
    def parse(cls, value: Any, frame: ArrayLike | None = None) -> Freedom:
        """Read what a caller gives as ``dof=``.

        Parameters
        ----------
        value : Freedom, str, or iterable of str
            A `Freedom` as it is; or words, separated by blanks or commas, that are free: ``"rz tx ty"``. Words with
            a minus are locked and the others free: ``"-rx -ry"``. Capitals do not matter.
        frame : array_like, (4, 4) or (3,), optional
            As in `only`; not together with a `Freedom`, which has one.

        Returns
        -------
        Freedom

        Examples
        --------
        >>> str(Freedom.parse("RZ, tx, ty"))
        'rz tx ty'
        """
        if isinstance(value, Freedom):
            if frame is not None:
                raise InputError("dof is a Freedom, which has a frame of its own; give that frame when making it")
            return value
        named, locked = read_words([value] if isinstance(value, str) else value)
        return cls.locked(*named, frame=frame) if locked else cls.only(*named, frame=frame)

    def __str__(self) -> str:
        return " ".join(word for word, free in zip(WORDS, self.mask, strict=True) if free) or "none"

    @property
    def mask(self) -> tuple[bool, ...]:
        """Whether rx, ry, rz, tx, ty, tz are free."""
        return self.turns + self.shifts

    @property
    def count(self) -> int:
        """Number of free ones."""
        return sum(self.mask)

    @property
    def is_group(self) -> bool:
        """Whether two allowed motions, one after the other, are always allowed together."""
        turning, shifting = sum(self.turns), sum(self.shifts)
        if turning == 1:
            across = [s for s, t in zip(self.shifts, self.turns, strict=True) if not t]
            return across[0] == across[1]
        return turning == 0 or (turning == 3 and shifting in (0, 3))

    def coordinates(self, T_target_source: ArrayLike, T_reference: ArrayLike) -> FloatArray:
        """The six numbers of the motion from a reference pose to a pose.

        Parameters
        ----------
        T_target_source, T_reference : array_like, (4, 4)
            Rigid poses.

        Returns
        -------
        ndarray, (6,)
            Rotation vector along the frame's axes in radians, at most pi long, then the translation of the frame's
            origin along them. Locked ones are zero, to rounding, exactly where the pose is allowed.

        Examples
        --------
        >>> from dqreg.rigid import pose
        >>> Freedom.only("rz").coordinates(pose.exp([0, 0, 0.5, 0, 0, 0]), np.eye(4)).round(12).tolist()
        [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]
        """
        motion = relative(self.frame, as_pose(T_target_source, "T_target_source"), as_pose(T_reference, "T_reference"))
        return np.concatenate([2.0 * quaternion.log(quaternion.canonical(motion.q))[1:], motion.t])

    def moved(self, T_reference: ArrayLike, coordinates: ArrayLike) -> FloatArray:
        """The pose that six numbers lead to: the inverse of `coordinates`.

        Parameters
        ----------
        T_reference : array_like, (4, 4)
            Pose that the motion starts from.
        coordinates : array_like, (6,)
            Rotation vector and translation; locked ones must be zero.

        Returns
        -------
        ndarray, (4, 4)
            T_target_source.

        Examples
        --------
        >>> Freedom.only("tx", "tz").moved(np.eye(4), [0, 0, 0, 2, 0, 1])[:3, 3].tolist()
        [2.0, 0.0, 1.0]
        """
        six = as_float(coordinates, "coordinates")
        if six.shape != (6,):
            raise InputError(f"coordinates must be six numbers, rotation vector and translation; got shape {six.shape}")
        require_finite(six, "coordinates")
        if (six[~np.array(self.mask)] != 0.0).any():
            raise InputError(f"coordinates must be zero where a motion is locked; free are {self}, got {six.tolist()}")
        motion = FrameMotion(quaternion.exp(np.r_[0.0, 0.5 * six[:3]]), six[3:])
        return compose(self.frame, motion, as_pose(T_reference, "T_reference"))

    def project(self, T_target_source: ArrayLike, T_reference: ArrayLike) -> FloatArray:
        """An allowed pose near a pose: the free parts of its motion are kept, the locked ones dropped.

        Parameters
        ----------
        T_target_source, T_reference : array_like, (4, 4)
            Rigid poses.

        Returns
        -------
        ndarray, (4, 4)
            T_target_source. With the nearest allowed rotation; the frame's origin keeps its free translations.

        Examples
        --------
        >>> from dqreg.rigid import pose
        >>> Freedom.only("tx").project(pose.from_parts(np.eye(3), [3, 4, 5]), np.eye(4))[:3, 3].tolist()
        [3.0, 0.0, 0.0]
        """
        T, T_ref = as_pose(T_target_source, "T_target_source"), as_pose(T_reference, "T_reference")
        return compose(self.frame, relative(self.frame, T, T_ref).within(self.turns, self.shifts), T_ref)

    def twists(self, T_target_source: ArrayLike, T_reference: ArrayLike, centre: ArrayLike = (0, 0, 0)) -> FloatArray:
        """The free motions at a pose, as left twists: the span of a covariance of the pose.

        Parameters
        ----------
        T_target_source, T_reference : array_like, (4, 4)
            An allowed pose and the reference.
        centre : array_like, (3,)
            Point of the target's frame about which the twists are taken.

        Returns
        -------
        ndarray, (6, k)
            A column for each: rotation vector, then the translation of the centre, along the target's axes. With an
            information matrix I about the same centre, ``B @ inv(B.T @ I @ B) @ B.T`` is the covariance.

        Examples
        --------
        >>> Freedom.only("rz").twists(np.eye(4), np.eye(4), centre=[1, 0, 0]).ravel().tolist()
        [0.0, 0.0, 1.0, 0.0, 1.0, 0.0]
        """
        motion = relative(self.frame, as_pose(T_target_source, "T_target_source"), as_pose(T_reference, "T_reference"))
        axes, pivot = self.frame[:3, :3], self.frame[:3, 3] + self.frame[:3, :3] @ motion.t
        turning = axes @ tangent(motion.within(self.turns, self.shifts).q, self.turns)
        shifting = axes[:, list(self.shifts)]
        carried = np.cross(turning.T, as_float(centre, "centre") - pivot).T
        return np.block([[turning, np.zeros_like(shifting)], [carried, shifting]])

    def recentred(self, origin_target: ArrayLike) -> Freedom:
        """The same freedom in target coordinates that count from another point.

        Parameters
        ----------
        origin_target : array_like, (3,)
            The point, in the old coordinates, that is zero in the new.

        Returns
        -------
        Freedom
            With the frame moved by minus the point.

        Examples
        --------
        >>> Freedom.only("rz", frame=[5, 0, 0]).recentred([2, 0, 0]).frame[:3, 3].tolist()
        [3.0, 0.0, 0.0]
        """
        frame = self.frame.copy()
        frame[:3, 3] -= as_frame(origin_target, "origin_target")[:3, 3]
        return dataclasses.replace(self, frame=frame)

    def brought_to(self, point: FloatArray) -> Freedom:
        """The same motions by a frame whose origin lies as near to a point as they allow.

        Rotations may be about any point that free translations make up for, and about any point of their axis. A near
        one keeps the digits where the frame's origin is far from the part.

        Parameters
        ----------
        point : ndarray, (3,)
            Target coordinates.

        Returns
        -------
        Freedom
            Allows the same poses.
        """
        turning = np.array(self.turns)
        if turning.sum() <= 1:
            across = np.array(self.shifts)[~turning].all()
            along = turning | across if turning.any() else np.ones(3, dtype=bool)
        else:
            along = np.full(3, all(self.shifts))
        axes = self.frame[:3, :3]
        frame = self.frame.copy()
        frame[:3, 3] += axes @ np.where(along, axes.T @ (point - self.frame[:3, 3]), 0.0)
        return dataclasses.replace(self, frame=frame)
