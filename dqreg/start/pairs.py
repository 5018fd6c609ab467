"""Start poses from pairs of oriented points: rare pairs of the scan, looked up among all pairs of the target.

Two points with normals fix a pose. The target's pairs are sorted by distance and angles; a pair of the scan that has
few counterparts there says much, so rare ones go first. All hypotheses are solved at once and screened on a grid of
distances.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray, IntArray
from dqreg.geometry import Mesh, PointCloud, Scan, Surface, sample_mesh
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.order import morton_order
from dqreg.solvers.oriented_pairs import OrientedPairs, poses_from_pairs
from dqreg.start.screening import DistanceGrid, distinct

# Points of the target whose pairs are tabulated: their square is the table.
TABLE_POINTS = 1_000
# Bins: distance in sizes, angles in radians.
LENGTH_BIN, ANGLE_BIN = 0.02, 0.2
# Shorter pairs fix the turn badly; a share of the size.
SHORTEST = 0.15
# Below this cosine between normal and line, the sign of the normal cannot be turned with certainty.
LEAST_COSINE = 0.15
# Triple products farther apart are of mirror images.
HAND_GAP = 0.35
# Pairs drawn from the scan, pairs used of these, counterparts of each, at most.
DRAWN, USED, COUNTERPARTS = 24_000, 3_000, 30
# Screening: few points for all, more for the best; reach in sizes; poses kept.
FEW, MORE, REACH, SHORTLIST, KEPT = 64, 500, 0.025, 600, 24


@dataclasses.dataclass(frozen=True)
class PairTable:
    """All far-apart pairs of sampled target points, sorted by key, and the grid for screening.

    Attributes
    ----------
    pairs : OrientedPairs
        The pairs in the order of their keys.
    keys : ndarray of int, (n,)
        Ascending.
    size : float
        Diagonal of the target.
    grid : DistanceGrid
        Distances to the target.
    """

    pairs: OrientedPairs
    keys: IntArray
    size: float
    grid: DistanceGrid

    @staticmethod
    def of(target: PointCloud | Mesh, surface: Surface) -> PairTable:
        """Table of a target; the same target gives the same table."""
        points = target.points if isinstance(target, PointCloud) else _even_points(target)
        points = points[morton_order(points)][sample_rows(len(points), TABLE_POINTS)]
        normals = surface.closest(points).normals
        known = normals.any(axis=1)
        points, normals = points[known], normals[known]
        i, j = np.nonzero(~np.eye(len(points), dtype=bool))
        far = np.linalg.norm(points[j] - points[i], axis=1) > SHORTEST * surface.diagonal
        pairs = OrientedPairs.of(points, normals, i[far], j[far])
        pairs = pairs[_certain(pairs)]
        keys = pair_keys(pairs, surface.diagonal)
        order = np.argsort(keys, kind="stable")
        grid = DistanceGrid(surface, points.min(axis=0), points.max(axis=0))
        return PairTable(pairs[order], keys[order], surface.diagonal, grid)


def pair_keys(pairs: OrientedPairs, size: float) -> IntArray:
    """One number per pair from its distance and its three angles, all binned.

    Parameters
    ----------
    pairs : OrientedPairs
        Pairs.
    size : float
        Unit of the distance.

    Returns
    -------
    ndarray of int, (n,)
        Equal for pairs that may be of the same two places.
    """
    angles = (np.arccos(np.clip(pairs.cosines, -1.0, 1.0)) / ANGLE_BIN).astype(np.int64)
    length = (pairs.length / (LENGTH_BIN * size)).astype(np.int64)
    keys: IntArray = ((length * 32 + angles[:, 0]) * 32 + angles[:, 1]) * 32 + angles[:, 2]
    return keys


def propose(scan: Scan, table: PairTable, rng: np.random.Generator) -> list[FloatArray]:
    """Distinct poses that explain the scan best on the grid, the best first.

    Parameters
    ----------
    scan : Scan
        Source with normals, signs known or not.
    table : PairTable
        Target.
    rng : numpy.random.Generator
        Draws pairs and screening points.

    Returns
    -------
    list of ndarray, (4, 4)
        Poses, at most 24; empty if no pair of the scan has a counterpart.
    """
    source = _draw_pairs(scan, table.size, rng)
    keys = pair_keys(source, table.size)
    first, last = (np.searchsorted(table.keys, keys, side) for side in ("left", "right"))
    counts = last - first
    rare = np.argsort(np.where(counts > 0, counts, np.iinfo(np.int64).max), kind="stable")[:USED]
    rare = rare[counts[rare] > 0]
    taken = np.minimum(counts[rare], COUNTERPARTS)
    rows = np.repeat(rare, taken)
    # Evenly through the counterparts, from a drawn place on: no order of the table is preferred.
    step = np.arange(len(rows)) - np.repeat(np.cumsum(taken) - taken, taken)
    shift = np.repeat(rng.random(len(rare)), taken)
    counterpart = first[rows] + ((step + shift) * counts[rows] / np.repeat(taken, taken)).astype(np.int64)
    agree = np.abs(source.handedness[rows] - table.pairs.handedness[counterpart]) < HAND_GAP
    R, t = poses_from_pairs(source[rows[agree]], table.pairs[counterpart[agree]])
    return _screen(R, t, scan, table, rng)


def _screen(R: FloatArray, t: FloatArray, scan: Scan, table: PairTable, rng: np.random.Generator) -> list[FloatArray]:
    for count, kept in ((FEW, SHORTLIST), (MORE, SHORTLIST)):
        points = scan.points[rng.choice(len(scan), size=min(count, len(scan)), replace=False)]
        best = np.argsort(-table.grid.scores(R, t, points, REACH * table.size), kind="stable")[:kept]
        R, t = R[best], t[best]
    poses = []
    for k in distinct(R, t, scan.points.mean(axis=0), 0.2, 0.05 * table.size, KEPT):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R[k], t[k]
        poses.append(T)
    return poses


def _draw_pairs(scan: Scan, size: float, rng: np.random.Generator) -> OrientedPairs:
    known = np.flatnonzero(scan.normals.any(axis=1))
    i, j = rng.choice(known, size=(2, DRAWN)) if len(known) else np.zeros((2, 0), dtype=np.int64)
    gap = np.linalg.norm(scan.points[j] - scan.points[i], axis=1)
    usable = (gap > SHORTEST * size) & (gap < size)
    pairs = OrientedPairs.of(scan.points, scan.normals, i[usable], j[usable])
    return pairs[_certain(pairs)]


def _certain(pairs: OrientedPairs) -> IntArray:
    return np.flatnonzero((np.abs(pairs.cosines[:, :2]) > LEAST_COSINE).all(axis=1))


def _even_points(mesh: Mesh) -> FloatArray:
    return sample_mesh(mesh, 20 * TABLE_POINTS, np.random.default_rng(0)).points
