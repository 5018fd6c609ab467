"""Initial poses from matched features: two clouds that overlap only in part share few pairs, but many local shapes.

Fast point feature histograms (Rusu 2009, from Open3D) are matched; most matches are outliers. Two inliers keep their
distance and the angle of their normals, and share many third matches that do so with both (SC2-PCR, Chen 2022): such
pairs and triples go into the closed form.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import suppress
from functools import cached_property

import numpy as np

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg._open3d import load_open3d
from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes, sample_rows
from dqreg.kernels.threads import NEVER, ask_clock, deadline_here
from dqreg.search.grids import Single
from dqreg.search.pairs import NORMALS_RAD
from dqreg.search.poses import Poses
from dqreg.solvers import solve_many
from dqreg.solvers.oriented_pairs import OrientedPairs, poses_from_pairs

# Points with a histogram.
HISTOGRAM_POINTS = 5_000
# Under a deadline, so many are made in one go, and so many rows are compared with all others: some milliseconds.
HISTOGRAMS_AT_ONCE, COMPARED_AT_ONCE = 250, 1_000
# Radius of a histogram in voxels; a voxel in sizes of the smaller side.
RADIUS_VOXELS, VOXEL_DIAGONALS = 5.0, 1.0 / 60.0
# Voxels along an extent at most, so that whole numbers count those of a box.
MAX_EXTENT_VOXELS = 1e6
# Neighbours of a normal, and those that its sign is propagated to.
NORMAL_NEIGHBOURS, SIGN_NEIGHBOURS = 30, 10
# Matches that are compared with each other.
COMPARED_MATCHES = 1_000
# How far two may change their distance, in voxels, and shortest distance.
MAX_STRETCH_VOXELS, MIN_DISTANCE_VOXELS = 1.5, 6.0
# Matches that most others support.
SEED_MATCHES = 150
# Partners of each, and others that make a triple with both.
SEED_PARTNERS, TRIPLES_PER_PAIR = 8, 3


@dataclasses.dataclass(frozen=True)
class FpfhCloud:
    """Points of a cloud with their normals and feature histograms."""

    # points, normals: (n, 3): Points, a voxel apart; normals of consistent sign where they could be made so
    points: FloatArray
    normals: FloatArray
    # all_points, all_normals: (m, 3): What the histograms are made of
    all_points: FloatArray
    all_normals: FloatArray
    kept: IntArray  # (n,): Rows of ``points`` there
    radius: float  # Of a histogram

    @cached_property
    def histograms(self) -> FloatArray:
        """Fast point feature histograms, (n, 33)."""
        return _histograms(self.all_points, self.all_normals, self.radius, self.kept)

    @cached_property
    def opposite_histograms(self) -> FloatArray:
        """The same for all normals reversed, (n, 33): which of both matches, only the other side decides."""
        return _histograms(self.all_points, -self.all_normals, self.radius, self.kept)

    @staticmethod
    def of(points: FloatArray, voxel: float, normals: FloatArray | None = None) -> FpfhCloud:
        """Points, normals and histograms of a cloud."""
        rows = first_in_voxels(points, voxel)
        ask_clock()
        rows = rows[morton_order(points[rows])]
        points = points[rows]
        if normals is None:
            tree = NeighbourTree(points)
            fitted = np.nan_to_num(fit_planes(tree, points, points, NORMAL_NEIGHBOURS).normals)
            normals = orient_consistently(fitted, tree.nearest(points, SIGN_NEIGHBOURS)[0])
        else:
            normals = normals[rows]
        kept = sample_rows(len(points), HISTOGRAM_POINTS)
        return FpfhCloud(points[kept], normals[kept], points, normals, kept, RADIUS_VOXELS * voxel)


def first_in_voxels(points: FloatArray, voxel: float) -> IntArray:
    """Rows of the first point in each voxel, ascending."""
    cells = ((points - bounds(points)[0]) / voxel).astype(np.int64)
    shape = cells.max(axis=0) + 1
    flat = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
    rows: IntArray = np.sort(np.unique(flat, return_index=True)[1])
    return rows


def orient_consistently(normals: FloatArray, neighbours: IntArray) -> FloatArray:
    """Normals whose signs agree with their neighbours', propagated along a minimum spanning tree (Hoppe 1992).

    Shapes: neighbours (n, k).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

    count = len(normals)
    i = np.repeat(np.arange(count), neighbours.shape[1])
    j = neighbours.ravel()
    unlike = 1.0 + 1e-6 - np.abs(np.einsum("ij,ij->i", normals[i], normals[j]))
    tree = minimum_spanning_tree(coo_array((unlike, (i, j)), shape=(count, count)).tocsr())
    parts = connected_components(tree, directed=False)[1]
    before = np.arange(count)
    for root in np.unique(parts, return_index=True)[1]:
        order, previous = breadth_first_order(tree, root, directed=False)
        before[order[1:]] = previous[order[1:]]
    sign = np.where(np.einsum("ij,ij->i", normals, normals[before]) < 0.0, -1.0, 1.0)
    # Each looks twice as far back as before: the product of all signs up to the root.
    while (before != before[before]).any():
        sign, before = sign * sign[before], before[before]
    sign = sign * np.where(before == np.arange(count), 1.0, sign[before])
    return normals * sign[:, None]


def match_features(source: FloatArray, target: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows of mutual nearest histograms, and, where these are few, of all nearest ones."""
    # Roots of fractions: differences of small bins count as well (Hellinger).
    a, b = (np.sqrt(x / np.maximum(x.sum(axis=1, keepdims=True), 1e-12)).astype(np.float32) for x in (source, target))
    ask_clock()
    likeness = a @ b.T
    there, back = _largest_places(likeness), _largest_places(likeness.T)
    rows = np.arange(len(a))
    mutual = back[there] == rows
    order = np.argsort(-(likeness[rows, there] + mutual), kind="stable")[:COMPARED_MATCHES]
    return order, there[order]


def _largest_places(values: Single) -> IntArray:
    """Column of the largest value of each row."""
    found = np.zeros(len(values), dtype=np.int64)
    for first in range(0, len(values), COMPARED_AT_ONCE):
        ask_clock()
        rows = slice(first, first + COMPARED_AT_ONCE)
        found[rows] = values[rows].argmax(axis=1)
    return found


def match_hypotheses(source: FpfhCloud, target: FpfhCloud, voxel: float, signs_known: bool = False) -> Poses:
    """Poses from pairs and triples of matches that are consistent with each other and with many others."""
    found = _from_matches(source, target, *match_features(source.histograms, target.histograms), voxel)
    if not signs_known:
        matches = match_features(source.opposite_histograms, target.histograms)
        found = found + _from_matches(source, target, *matches, voxel)
    return found


def _from_matches(source: FpfhCloud, target: FpfhCloud, i: IntArray, j: IntArray, voxel: float) -> Poses:
    p, q = source.points[i], target.points[j]
    agree = _consistency(p, q, source.normals[i], target.normals[j], voxel)
    ask_clock()
    # How many third matches agree with both, where both agree.
    shared = agree * (agree @ agree)
    seeds = np.argsort(-shared.sum(axis=1), kind="stable")[:SEED_MATCHES]
    ask_clock()
    partners = _largest(shared[seeds], SEED_PARTNERS)
    first, second = np.repeat(seeds, partners.shape[1]), partners.ravel()
    sound = shared[first, second] > 0.0
    first, second = first[sound], second[sound]
    if not len(first):
        return Poses.of(np.zeros((0, 4, 4)))
    pairs = OrientedPairs.of(p, source.normals[i], first, second), OrientedPairs.of(q, target.normals[j], first, second)
    poses = Poses(*poses_from_pairs(*pairs))
    thirds = _largest(shared[first] * agree[second], TRIPLES_PER_PAIR)
    count = thirds.shape[1]
    triples = np.stack([np.repeat(first, count), np.repeat(second, count), thirds.ravel()], axis=1)
    sound = (agree[triples[:, 0], triples[:, 2]] > 0.0) & (agree[triples[:, 1], triples[:, 2]] > 0.0)
    fits = solve_many(p[triples[sound]], q[triples[sound]])
    return poses + Poses.of(fits.T_target_source[~fits.degenerate])


def _largest(values: Single, count: int) -> IntArray:
    """Columns of the largest values of each row, in no order."""
    count = min(count, values.shape[1])
    return np.argpartition(-values, count - 1, axis=1)[:, :count]


def _consistency(p: FloatArray, q: FloatArray, n: FloatArray, m: FloatArray, voxel: float) -> Single:
    """1 where two matches may both be inliers, (k, k), single precision."""
    lengths, angles = [], []
    for points, normals in ((p, n), (q, m)):
        # In voxels: the squares of lengths may be beyond single precision.
        arms, directions = ((points - points.mean(axis=0)) / voxel).astype(np.float32), normals.astype(np.float32)
        squared = (arms**2).sum(axis=1)
        lengths.append(np.sqrt(np.maximum(squared[:, None] + squared[None, :] - 2.0 * arms @ arms.T, 0.0)))
        angles.append(np.arccos(np.clip(np.abs(directions @ directions.T), 0.0, 1.0)))
    agree = (np.abs(lengths[0] - lengths[1]) < MAX_STRETCH_VOXELS) & (np.minimum(*lengths) > MIN_DISTANCE_VOXELS)
    agree &= np.abs(angles[0] - angles[1]) < NORMALS_RAD
    both: Single = agree.astype(np.float32)
    return both


def _histograms(points: FloatArray, normals: FloatArray, radius: float, kept: IntArray) -> FloatArray:
    """Those of some rows, (n, 33); under a deadline a few at a time, as nothing asks the clock within a call."""
    open3d = load_open3d()
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.normals = open3d.utility.Vector3dVector(normals)
    near = open3d.geometry.KDTreeSearchParamHybrid(radius=radius, max_nn=100)
    histograms_of = open3d.pipelines.registration.compute_fpfh_feature
    if deadline_here() < NEVER:
        # Open3D 0.19 knows no rows.
        with suppress(TypeError):
            return np.concatenate([histograms_of(cloud, near, rows).data.T for rows in _in_turn(kept)])
    found: FloatArray = np.asarray(histograms_of(cloud, near).data).T[kept]
    return found


def _in_turn(rows: IntArray) -> Iterator[list[int]]:
    for first in range(0, len(rows), HISTOGRAMS_AT_ONCE):
        ask_clock()
        yield rows[first : first + HISTOGRAMS_AT_ONCE].tolist()
