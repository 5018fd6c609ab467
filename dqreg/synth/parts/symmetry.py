"""Which rigid motions put a part onto itself."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import pose


@dataclass(frozen=True, eq=False)
class Symmetry:
    """Motions of a part that leave its surface where it is, in the part's frame."""

    poses: FloatArray  # (k, 4, 4): Every such motion, or for a round part one of each kind; the identity comes first
    near: FloatArray  # (m, 4, 4): Motions that all but a small feature of the part allows
    # (2, 3): A point on the axis of a round part and the axis's direction: any turn about it is one more motion, before
    # or after those of ``poses``
    axis: FloatArray | None = None


def none() -> Symmetry:
    """Return the symmetry of a part that has none."""
    return Symmetry(np.eye(4)[None], np.zeros((0, 4, 4)))


def about_z(order: int, *, flips: bool = False) -> FloatArray:
    """Make turns about the z axis by equal steps, and half-turns about axes across it.

    Shapes: returns (order or 2 order, 4, 4).
    """
    turn = np.arange(order) * (2.0 * np.pi / order)
    T = np.broadcast_to(np.eye(4), (order, 4, 4)).copy()
    T[:, 0, 0] = T[:, 1, 1] = np.cos(turn)
    T[:, 1, 0], T[:, 0, 1] = np.sin(turn), -np.sin(turn)
    return np.concatenate([T, T @ np.diag([1.0, -1.0, -1.0, 1.0])]) if flips else T


def of_box(size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> FloatArray:
    """Find the turns that put a rectangular block onto itself.

    Shapes: returns (4, 8 or 24, 4, 4).
    """
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[range(3), order] = signs
            if np.linalg.det(R) > 0.0 and all(size[i] == size[order[i]] for i in range(3)):
                found.append(pose.about(pose.from_parts(R, np.zeros(3)), np.asarray(centre, dtype=np.float64)))
    return np.stack(found)
