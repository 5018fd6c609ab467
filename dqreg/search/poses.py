"""Many poses at once."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.threads import ask_clock


@dataclasses.dataclass(frozen=True)
class Poses:
    """Poses, the best first where they are in an order."""

    R: FloatArray  # (n, 3, 3): Rotations
    t: FloatArray  # (n, 3): Translations

    @staticmethod
    def of(T: FloatArray) -> Poses:
        """Poses of matrices, (n, 4, 4)."""
        return Poses(T[:, :3, :3], T[:, :3, 3])

    def __len__(self) -> int:
        return len(self.R)

    def __getitem__(self, rows: IntArray) -> Poses:
        return Poses(self.R[rows], self.t[rows])

    def __add__(self, other: Poses) -> Poses:
        return Poses(np.concatenate([self.R, other.R]), np.concatenate([self.t, other.t]))

    def first(self, count: int) -> Poses:
        """So many of them, or all."""
        return self[np.arange(min(count, len(self)))]

    @property
    def inverse(self) -> Poses:
        """From target to source."""
        back = self.R.transpose(0, 2, 1)
        return Poses(back, -np.einsum("nij,nj->ni", back, self.t))

    @property
    def matrices(self) -> FloatArray:
        """The same as matrices, (n, 4, 4)."""
        T = np.tile(np.eye(4), (len(self), 1, 1))
        T[:, :3, :3], T[:, :3, 3] = self.R, self.t
        return T

    def apply(self, points: FloatArray) -> FloatArray:
        """Points, (m, 3), moved by each pose, (n, m, 3)."""
        return self.turn(points) + self.t[:, None, :]

    def turn(self, directions: FloatArray) -> FloatArray:
        """Directions, (m, 3), turned by each pose, (n, m, 3)."""
        return directions @ self.R.transpose(0, 2, 1)

    def then(self, T: FloatArray) -> Poses:
        """Each pose followed by each of some motions of the target, (k, 4, 4)."""
        return Poses(
            np.concatenate([M[:3, :3] @ self.R for M in T]),
            np.concatenate([self.t @ M[:3, :3].T + M[:3, 3] for M in T]),
        )

    def distinct(self, middle: FloatArray, angle_rad: float, offset: float, most: int) -> IntArray:
        """Rows of the first poses that differ from all kept before them, by an angle or at a point of the source."""
        from dqreg.kernels.search.many_poses import distinct_rows
        from dqreg.kernels.threads import as_plain

        ask_clock()
        places = as_plain(self.R @ middle + self.t)
        rows: IntArray = distinct_rows(as_plain(self.R), places, _chord(angle_rad), float(offset), int(most))
        return rows

    def beside(self, others: Poses, middle: FloatArray, angle_rad: float, offset: float) -> BoolArray:
        """Which, (n,), differ by less than that from one of some others."""
        turned = np.linalg.norm(self.R[:, None] - others.R, axis=(2, 3)) < _chord(angle_rad)
        shifted = np.linalg.norm((self.R @ middle + self.t)[:, None] - (others.R @ middle + others.t), axis=2) < offset
        found: BoolArray = (turned & shifted).any(axis=1)
        return found


def _chord(angle_rad: float) -> float:
    """How far two rotations by that angle to each other are apart in the Frobenius norm."""
    return float(2.0 * np.sqrt(2.0) * np.sin(0.5 * angle_rad))
