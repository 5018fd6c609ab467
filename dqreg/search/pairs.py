"""Initial poses from pairs of oriented points: rare pairs of the scan, looked up among all pairs of the target.

Two oriented points fix a pose. The target's pairs are sorted by distance and angles; a pair of the scan that has few
counterparts there is discriminative, so rare ones go first. All hypotheses are solved at once.
"""

from __future__ import annotations

import dataclasses
import threading
from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, IntArray, bounds
from dqreg.geometry import Mesh, PointCloud, Surface
from dqreg.kernels.threads import ask_clock, until
from dqreg.rigid.symmetry import Symmetry
from dqreg.search.features import even_points, target_features
from dqreg.search.grids import Edges, PlaneGrid
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses
from dqreg.search.symmetry import find_symmetry
from dqreg.solvers.oriented_pairs import OrientedPairs, poses_from_pairs

# Points of the target whose pairs are tabulated: their square is the table. They are drawn from so many.
TABLE_POINTS, DENSE = 1_000, 20_000
# Bins: distance in sizes, angles in radians.
LENGTH_BIN, ANGLE_BIN = 0.02, 0.2
# Numbers that a key may be: bins of lengths up to the size times eight of each angle.
KEYS = (round(1.0 / LENGTH_BIN) + 1) * 512
# Shorter pairs constrain the rotation badly; in sizes.
SHORTEST = 0.15
# Below this cosine between direction and line, the sign of the direction is uncertain: both are tried.
LEAST_COSINE = 0.15
# Pairs in which either direction stands at a smaller sine to the line constrain the rotation about it too little.
LEAST_SINE = 0.15
# Fitted normals of corresponding points differ by no more than this, signs aside.
NORMALS_RAD = 0.45
# Pairs drawn from the scan, pairs used of these, counterparts of each, at most.
DRAWN, USED, COUNTERPARTS = 24_000, 3_000, 30
# Draws at most where most pairs are too long, in multiples.
ROUNDS = 12


@dataclasses.dataclass(frozen=True)
class PairTable:
    """All far-apart pairs of points of a target, sorted by key, and the grids for screening."""

    points: OrientedPoints  # On faces, then at edges
    # first, second: (n,): The pairs, rows of the points, in the order of their keys
    first: IntArray
    second: IntArray
    keys: IntArray  # (n,): Ascending
    size: float  # Diagonal of the target
    grid: PlaneGrid  # Distances to the target, and its tangent planes
    edges: Edges | None  # Edges of the target, where there are any
    target: PointCloud | Mesh  # The target
    surface: Surface  # The same
    _lock: threading.Lock = dataclasses.field(default_factory=threading.Lock, repr=False, compare=False)

    @cached_property
    def starts(self) -> IntArray:
        """First row of each key, and after the last key the number of rows: keys are looked up, not searched."""
        found: IntArray = np.searchsorted(self.keys, np.arange(KEYS + 1))
        return found

    @cached_property
    def symmetry(self) -> Symmetry | None:
        """Symmetries of a mesh, found when first asked for and kept; None for a cloud."""
        if not isinstance(self.target, Mesh):
            return None
        with self._lock:
            if "symmetry" in self.__dict__:
                found: Symmetry = self.__dict__["symmetry"]
                return found
            with until(np.inf):
                return find_symmetry(self.target, self.surface, self.grid)

    @staticmethod
    def of(target: PointCloud | Mesh, surface: Surface) -> PairTable:
        """Table of a target; the same target gives the same table."""
        even = even_points(target, surface, DENSE)
        points, edges = target_features(target, even, TABLE_POINTS)
        # A target without a single normal has no oriented points, but it has a size.
        bare = target.vertices if isinstance(target, Mesh) else target.points
        low, high = bounds(points.points if len(points) else bare)
        first, second = np.nonzero(~np.eye(len(points), dtype=bool))
        keys, usable = pair_keys(points, first, second, surface.diagonal)
        rows = np.flatnonzero(usable)
        rows = rows[np.argsort(keys[rows], kind="stable")]
        grid = PlaneGrid(surface, even, low, high)
        known = Edges.of(edges, low, high, surface.diagonal) if len(edges) else None
        first, second = first[rows], second[rows]
        return PairTable(points, first, second, keys[rows], surface.diagonal, grid, known, target, surface)


def pair_keys(oriented: OrientedPoints, i: IntArray, j: IntArray, size: float) -> tuple[IntArray, BoolArray]:
    """One number per pair, of its distance and three angles, binned and without signs; and whether it is usable."""
    # Single precision is far finer than a bin.
    points = (oriented.points / size).astype(np.float32)
    directions = oriented.directions.astype(np.float32)
    along = points[j] - points[i]
    length = np.sqrt(np.einsum("ij,ij->i", along, along))
    along /= np.maximum(length, 1e-6)[:, None]
    cosines = np.abs(
        [
            np.einsum("ij,ij->i", directions[i], along),
            np.einsum("ij,ij->i", directions[j], along),
            np.einsum("ij,ij->i", directions[i], directions[j]),
        ]
    )
    angles = (np.arccos(np.minimum(cosines, 1.0)) / ANGLE_BIN).astype(np.int64)
    usable = (length > SHORTEST) & (length < 1.0) & (cosines[:2].min(axis=0) < np.sqrt(1.0 - LEAST_SINE**2))
    keys = ((length / LENGTH_BIN).astype(np.int64) * 8 + angles[0]) * 64 + angles[1] * 8 + angles[2]
    return keys, usable


def pair_hypotheses(scan: OrientedPoints, table: PairTable, rng: np.random.Generator) -> Poses:
    """Poses that put pairs of the scan on their counterparts of the target."""
    i, j, keys = _draw_pairs(scan, table.size, rng)
    first, last = table.starts[keys], table.starts[keys + 1]
    counts = last - first
    rare = np.argsort(np.where(counts > 0, counts, np.iinfo(np.int64).max), kind="stable")[:USED]
    rare = rare[counts[rare] > 0]
    taken = np.minimum(counts[rare], COUNTERPARTS)
    rows = np.repeat(rare, taken)
    # Evenly through the counterparts, from a drawn one on: no order of the table is preferred.
    step = np.arange(len(rows)) - np.repeat(np.cumsum(taken) - taken, taken)
    shift = np.repeat(rng.random(len(rare)), taken)
    counterpart = first[rows] + ((step + shift) * counts[rows] / np.repeat(taken, taken)).astype(np.int64)
    ask_clock()
    source = OrientedPairs.of(scan.points, scan.directions, i[rows], j[rows])
    known = table.points
    target = OrientedPairs.of(known.points, known.directions, table.first[counterpart], table.second[counterpart])
    poses = _solve(source, target, opposite=False)
    ask_clock()
    return poses + _solve(source, target, opposite=True)


def _solve(source: OrientedPairs, target: OrientedPairs, opposite: bool) -> Poses:
    """Poses with directions along the lines, or with the target's opposite where the sign is uncertain."""
    if opposite:
        steep = np.abs(source.cosines[:, 0]) <= np.abs(source.cosines[:, 1])
        guide = np.where(steep, np.abs(source.cosines[:, 0]), np.abs(source.cosines[:, 1]))
        rows = np.flatnonzero(guide < LEAST_COSINE)
        source, target = source[rows], target[rows]
        target = dataclasses.replace(target, first=-target.first, second=-target.second)
    R, t = poses_from_pairs(source, target)
    least = np.cos(NORMALS_RAD)
    agree = np.ones(len(R), dtype=bool)
    for ours, theirs in ((source.first, target.first), (source.second, target.second)):
        agree &= np.abs(np.einsum("nij,nj,ni->n", R, ours, theirs, optimize=True)) > least
    return Poses(R[agree], t[agree])


def _draw_pairs(scan: OrientedPoints, size: float, rng: np.random.Generator) -> tuple[IntArray, IntArray, IntArray]:
    found: list[tuple[IntArray, IntArray, IntArray]] = [(np.zeros(0, dtype=np.int64),) * 3]
    count = 0
    for _ in range(ROUNDS):
        i, j = scan.draw(DRAWN, rng), scan.draw(DRAWN, rng)
        keys, usable = pair_keys(scan, i, j, size)
        found.append((i[usable], j[usable], keys[usable]))
        count += int(np.count_nonzero(usable))
        # A scene is much larger than the part: most of its pairs are too long.
        if 2 * count >= DRAWN or not len(i):
            break
    i, j, keys = (np.concatenate([part[k] for part in found]) for k in range(3))
    return i, j, keys
