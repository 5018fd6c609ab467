"""All scans in one cloud, and the pieces of plane faces that several of them see.

Together scans sample a face many times as densely as each of them alone: a strip as wide as their spacing, on which no
normal can be fitted in one scan, is some points wide there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from dqreg._arrays import FloatArray, IntArray
from dqreg.multiway.refinement.bodies import Body
from dqreg.rigid import pose

# Points of all scans together.
MAX_POINTS = 1_000_000
# Each so manieth point is the seed of a piece, which takes some of so many neighbours.
POINTS_PER_SEED, PIECE_NEIGHBOURS = 3, 48
# Numbers of a plane.
PLANE_NUMBERS = 3


@dataclasses.dataclass(frozen=True)
class Pieces:
    """Pieces of planes, by what each scan sees of them: its group. Groups of a piece follow each other."""

    starts: IntArray  # (pieces + 1,): First group of each
    scans: IntArray  # (groups,)
    moments: FloatArray  # (groups, 4, 4): Sums of ``(x, 1) (x, 1)^T`` in the scan's centred frame
    residual: float  # Of the typical point from its plane

    @property
    def points(self) -> float:
        """How many lie on them."""
        return float(self.moments[:, 3, 3].sum())

    def moved(self, T: FloatArray) -> FloatArray:
        """The moments with each scan at its pose, (groups, 4, 4)."""
        poses = T[self.scans]
        return np.ascontiguousarray(poses @ self.moments @ poses.transpose(0, 2, 1))

    def scores(self, slopes: FloatArray, count: int) -> sparse.csr_matrix:
        """Slopes of the groups, (groups, 6), as columns of their pieces, (6 count, pieces), jackknifed."""
        number = np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))
        points = np.add.reduceat(self.moments[:, 3, 3], self.starts[:-1])
        values = slopes * (points / (points - PLANE_NUMBERS))[number][:, None]
        rows = (6 * self.scans[:, None] + np.arange(6)).ravel()
        return sparse.csr_matrix((values.ravel(), (rows, np.repeat(number, 6))), shape=(6 * count, len(points)))


class Pooled:
    """Points of all scans in their centred frames, in units of a length."""

    def __init__(self, bodies: Sequence[Body], unit: float) -> None:
        rows = [body.rows(MAX_POINTS // len(bodies)) for body in bodies]
        rows = [r[~body.single[r]] for r, body in zip(rows, bodies, strict=True)]
        self.points = np.concatenate([body.planed.points[r] for body, r in zip(bodies, rows, strict=True)]) / unit
        self.normals = np.concatenate([body.planed.normals[r] for body, r in zip(bodies, rows, strict=True)])
        self.scans = np.repeat(np.arange(len(bodies)), [len(r) for r in rows])
        self.signed = all(body.scan is not None and body.scan.oriented for body in bodies)
        # Distances that cannot be real: of scans without noise.
        self.floor = min(body.noise_floor for body in bodies) / unit
        self.seeds = np.arange(0, len(self.points), POINTS_PER_SEED)
        self._neighbours: tuple[FloatArray, IntArray] | None = None

    def pieces(self, T: FloatArray, scale: float, near: float) -> Pieces:
        """Pieces within a scale of their planes. Neighbours are those of poses as near as said."""
        from dqreg.kernels.clouds.plane_growth import measure_pieces, take_pieces
        from dqreg.kernels.threads import over_chunks

        points = np.einsum("nij,nj->ni", T[self.scans, :3, :3], self.points) + T[self.scans, :3, 3]
        normals = np.einsum("nij,nj->ni", T[self.scans, :3, :3], self.normals)
        neighbours = self._around(points, near)
        count = len(self.seeds)
        sizes, residuals = np.zeros(count, dtype=np.int64), np.zeros(count)
        given = points, normals, self.seeds, neighbours, scale, self.signed
        over_chunks(measure_pieces, count, *given, sizes, residuals)
        # The largest first, of equally large ones the flattest.
        order = np.lexsort((residuals, -sizes))
        order = order[sizes[order] > 0]
        labels = np.full(len(points), -1, dtype=np.int64)
        take_pieces(points, normals, self.scans, *given[2:], order, labels)
        kept = np.flatnonzero(labels >= 0)
        if not len(kept):
            return Pieces(np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4)), scale)
        typical = max(float(np.median(np.repeat(residuals[order], sizes[order]))), self.floor)
        return self._grouped(kept, labels[kept], typical)

    def _around(self, points: FloatArray, near: float) -> IntArray:
        from dqreg.kernels.trees.point_tree import PointTree

        known = self._neighbours
        if known is None or float(np.abs(points - known[0]).max()) > near:
            found, _ = PointTree.of(points).nearest(points[self.seeds], min(PIECE_NEIGHBOURS, len(points)))
            self._neighbours = known = points, np.ascontiguousarray(found, dtype=np.int64)
        return known[1]

    def _grouped(self, kept: IntArray, labels: IntArray, typical: float) -> Pieces:
        order = np.lexsort((self.scans[kept], labels))
        kept, labels = kept[order], labels[order]
        scans = self.scans[kept]
        first = np.flatnonzero(np.r_[True, (np.diff(labels) != 0) | (np.diff(scans) != 0)])
        rows = np.column_stack([self.points[kept], np.ones(len(kept))])
        moments = np.add.reduceat(rows[:, :, None] * rows[:, None], first, axis=0)
        starts = np.flatnonzero(np.r_[True, np.diff(labels[first]) != 0, True])
        return Pieces(starts, scans[first], moments, typical)


def centred(T: FloatArray, unit: float) -> tuple[FloatArray, FloatArray]:
    """Poses in units of a length about the middle of their origins, and that middle."""
    middle = np.mean(T[:, :3, 3], axis=0)
    moved = pose.from_parts(np.eye(3), -middle) @ T
    moved[:, :3, 3] /= unit
    return moved, middle
