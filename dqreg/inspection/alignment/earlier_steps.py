"""What an alignment leaves of the uncertainty of the pose that it began at: motions that are locked keep theirs."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import remember, remembered
from dqreg.rigid import pose, twist


class Aligned(Protocol):
    """An alignment with its own covariance about a place."""

    @property
    def covariance(self) -> FloatArray: ...  # noqa: D102

    @property
    def centre(self) -> FloatArray: ...  # noqa: D102


A = TypeVar("A", bound=Aligned)


def with_kept(alignment: A, kept: FloatArray) -> A:
    """The alignment, which now tells what it leaves of a twist before it about its centre, (6, 6)."""
    return remember(alignment, _kept_twist=kept)


def kept_by(alignment: Aligned) -> FloatArray:
    """How much of a small twist before an alignment is there after it, both about its centre, (6, 6)."""
    # One that remembers nothing has determined all anew.
    kept: FloatArray = remembered(alignment, "_kept_twist", np.zeros((6, 6)))
    return kept


def left_of(information: FloatArray, basis: FloatArray) -> FloatArray:
    """What is left of a twist where least squares may take the directions of a basis alone. Shapes: (6, 6), (6, k).

    The free motions follow the others: a part that is turned about a locked axis is shifted until its faces fit again.
    """
    if not basis.shape[1]:
        return np.eye(6)
    taken = basis @ np.linalg.pinv(basis.T @ information @ basis, hermitian=True) @ basis.T @ information
    return np.asarray(np.eye(6) - taken)


def covariance_after(alignment: Aligned, before: FloatArray, centre: FloatArray) -> FloatArray:
    """Covariance of the pose after an alignment, about its centre, given that before it, about another, (6, 6)."""
    carried = kept_by(alignment) @ twist.adjoint(pose.from_parts(np.eye(3), centre - alignment.centre))
    total: FloatArray = alignment.covariance + carried @ before @ carried.T
    return 0.5 * (total + total.T)
