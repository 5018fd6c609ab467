"""Poses from two oriented points each: the smallest matches that fix a pose, thousands at once."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray


@dataclasses.dataclass(frozen=True)
class OrientedPairs:
    """Pairs of points with normals whose signs are made comparable.

    The sign of a fitted normal is unknown; here each is turned so that it does not point against the line from the
    first point to the second, which any rigid motion preserves.
    """

    middle: FloatArray  # (n, 3): Middle of the two points
    length: FloatArray  # (n,): Distance between them
    along: FloatArray  # (n, 3): Unit vector from the first to the second
    # first, second: (n, 3): Their normals, signs turned
    first: FloatArray
    second: FloatArray

    @staticmethod
    def of(points: FloatArray, normals: FloatArray, i: IntArray, j: IntArray) -> OrientedPairs:
        """Pairs (i, j) of points and unit normals, (m, 3); no pair may be of two equal points."""
        offset = points[j] - points[i]
        length = np.linalg.norm(offset, axis=1)
        along = offset / length[:, None]
        return OrientedPairs(
            0.5 * (points[i] + points[j]), length, along, _turned(normals[i], along), _turned(normals[j], along)
        )

    def __getitem__(self, rows: IntArray | BoolArray) -> OrientedPairs:
        return OrientedPairs(
            self.middle[rows], self.length[rows], self.along[rows], self.first[rows], self.second[rows]
        )

    @property
    def cosines(self) -> FloatArray:
        """Cosines of first normal and line, second normal and line, both normals, (n, 3)."""
        pairs = ((self.first, self.along), (self.second, self.along), (self.first, self.second))
        return np.stack([np.einsum("ij,ij->i", a, b) for a, b in pairs], axis=1)


def poses_from_pairs(source: OrientedPairs, target: OrientedPairs) -> tuple[FloatArray, FloatArray]:
    """Pose of each source pair on its target pair: middle on middle, line on line, normals as near as can be.

    Shapes: R (n, 3, 3).
    """
    # The normal farther off the line determines the rotation about it better.
    steep = np.abs(source.cosines[:, 0]) <= np.abs(source.cosines[:, 1])
    frames = []
    for pairs in (source, target):
        guide = np.where(steep[:, None], pairs.first, pairs.second)
        across = guide - np.einsum("ij,ij->i", guide, pairs.along)[:, None] * pairs.along
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), np.finfo(float).tiny)
        frames.append(np.stack([pairs.along, across, np.cross(pairs.along, across)], axis=2))
    R = frames[1] @ frames[0].transpose(0, 2, 1)
    return R, target.middle - np.einsum("nij,nj->ni", R, source.middle)


def _turned(normals: FloatArray, along: FloatArray) -> FloatArray:
    against = np.einsum("ij,ij->i", normals, along) < 0.0
    return np.where(against[:, None], -normals, normals)
