"""Motion of the part against the scanner while it scans: one constant twist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray, as_float
from dqreg._numbers import is_number
from dqreg.errors import InputError
from dqreg.rigid import pose


@dataclass(frozen=True)
class Motion:
    """Constant twist during the sweep.

    A point that is at ``p`` on the part at the reference time is at ``M(t) p`` when it is read, with
    ``M(t) = exp((t - reference) twist)``. Time counts in sweeps: 0 at its start, 1 at its end.

    Attributes
    ----------
    turn_rad : (float, float, float)
        Rotation vector of the whole sweep, about the part's centre, along the axes of its frame.
    shift : (float, float, float)
        Translation part of the whole sweep, in diagonals of the part.
    reference : float
        Time of the pose that the truth gives, from 0 to 1.

    Raises
    ------
    InputError
        If a value cannot be; the message names it.

    Examples
    --------
    >>> Motion(turn_rad=(0.0, 0.0, 0.1)).twist(np.array([1.0, 0.0, 0.0]), 10.0).tolist()
    [0.0, 0.0, 0.1, 0.0, -0.1, 0.0]
    """

    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    reference: float = 0.5

    def __post_init__(self) -> None:
        for name, most, what in (("turn_rad", np.pi, "a half-turn"), ("shift", 10.0, "10 diagonals")):
            value = as_float(getattr(self, name), name)
            if value.shape != (3,) or not np.linalg.norm(value) <= most:
                raise InputError.of(
                    f"must be three numbers, together at most {what}", name=name, given=getattr(self, name)
                )
        if not is_number(self.reference):
            raise InputError.of("must be a number from 0 to 1", name="reference", given=self.reference)
        if not 0.0 <= self.reference <= 1.0:
            raise InputError.of("must be a number from 0 to 1", name="reference", given=self.reference)

    def twist(self, centre: FloatArray, diagonal: float) -> FloatArray:
        """Twist of the whole sweep about the origin of the part's frame.

        Parameters
        ----------
        centre : ndarray, (3,)
            Centre of the part.
        diagonal : float
            Its diagonal.

        Returns
        -------
        ndarray, (6,)
            Rotation first, then translation, per sweep.

        Examples
        --------
        >>> Motion(shift=(0.1, 0.0, 0.0)).twist(np.zeros(3), 10.0).tolist()
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
        """
        turn, shift = np.asarray(self.turn_rad, dtype=np.float64), diagonal * np.asarray(self.shift, dtype=np.float64)
        return np.concatenate([turn, shift + np.cross(centre, turn)]) + 0.0


def poses_at(twist: FloatArray, since_reference: FloatArray) -> FloatArray:
    """Return the poses of a constant twist. Shapes: twist (6,), returns (n, 4, 4)."""
    return pose.exp(since_reference[:, None] * twist)


def moved_each(T: FloatArray, points: FloatArray) -> FloatArray:
    """Move each point by a pose of its own. Shapes: T (n, 4, 4)."""
    return turned_each(T, points) + T[:, :3, 3]


def turned_each(T: FloatArray, directions: FloatArray) -> FloatArray:
    """Rotate each direction by a pose of its own. Shapes: T (n, 4, 4)."""
    turned: FloatArray = np.einsum("nij,nj->ni", T[:, :3, :3], directions)
    return turned
