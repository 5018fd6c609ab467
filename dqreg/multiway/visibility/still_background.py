"""What stands still before the scanner, registered in the place of the part: backdrop, floor, bench, fixture.

Scans of a part that turns are in the scanner's frame, and so is all around it: most of each scan fits all others where
it is, better than the part does anywhere. What moved tells: surfaces that one scan alone has, and that cross those of
others. Scans that were aligned before have none that cross, and of a part that stood still none that others lack.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.multiway.pairwise.pairs import Order
from dqreg.multiway.pose_graph.edges import PART, Edge
from dqreg.multiway.scans.scans import View, every_so_many, size_of, typical_spacing
from dqreg.rigid import pose
from dqreg.trust.records import Reason

# A pair stands still where its pose moves no corner of its scan by more than so many spacings; and share of the pairs.
STILL_SPACINGS, MIN_STILL_SHARE = 0.5, 0.5
# Scans that are compared with each other, and points of each.
MAX_SCANS, COMPARED_POINTS = 8, 3_000
# A point is on another scan within so many spacings, and so many scales of noise; it is this scan's alone where it is
# on at most this share of the others.
ON_SPACINGS, ON_NOISES = 3.0, 4.0
MAX_SHARED = 1 / 3
# It crosses what another scan shows where it stands off it this nearly along its normal, and turned by more than this,
# no farther than this in sizes, and not at its rim: there neighbours stand to one side, by this share of their reach.
MIN_OFF_COS, MAX_CROSSING_COS = 0.8, 0.8
MAX_OFF_SIZES, MAX_RIM_SHARE = 0.1, 0.25
RIM_NEIGHBOURS = 12
# Least share of points that are one scan's alone, and of these, for each other scan, that cross it.
MIN_ALONE, MIN_CROSSING = 0.02, 0.06
# Fewer do where the rest is on nearly all other scans, this share of all points at least, and few are on some of them
# only, as those of scans from all round a part are: a plate that turns crosses itself in few places.
MIN_CROSSING_BEFORE_STILL = 0.025
STILL_ON_SHARE, MIN_STILL = 0.8, 0.6
MAX_ON_SOME = 0.25


def unmoved_scans(
    views: Sequence[View], edges: Sequence[Edge], T_world_scan: FloatArray, order: Order, *, started: bool
) -> Iterator[Reason]:
    """A doubt where most used pairs do not move, although a table does, or what one scan alone has moved.

    Shapes: T_world_scan (n, 4, 4), NaN where not placed.
    """
    spacing = typical_spacing(views)
    pairs = [
        (edge.target, edge.source)
        for edge in edges
        if edge.used and edge.target != PART and np.isfinite(T_world_scan[[edge.target, edge.source]]).all()
    ]
    still = [pair for pair in pairs if _moved_by(views, T_world_scan, *pair) <= STILL_SPACINGS * spacing]
    if started or not still or len(still) <= MIN_STILL_SHARE * len(pairs):
        return
    if order != "turntable" and not _parts_cross(views, sorted({k for pair in still for k in pair}), T_world_scan):
        return
    yield Reason(
        f"{'the step of the table is 0 degrees: ' if order == 'turntable' else ''}in {len(still)} of {len(pairs)} "
        "pairs the scans stay where they are, as what stands still before the scanner does (backdrop, floor, "
        f"fixture){'' if order == 'turntable' else ', and what one of them alone shows moved'}: that was registered, "
        "and not the part. Cut the background away, or give starts if all scans are in one frame",
        "unmoved_scans",
    )


def _moved_by(views: Sequence[View], T_world_scan: FloatArray, i: int, j: int) -> float:
    """Greatest motion of a scan's points between its own frame and the other one's."""
    cloud = views[j].cloud
    assert cloud is not None
    points = every_so_many(cloud.points, COMPARED_POINTS)
    moved = pose.apply(pose.inverse(T_world_scan[i]) @ T_world_scan[j], points)
    return float(np.linalg.norm(moved - points, axis=1).max())


def _parts_cross(views: Sequence[View], scans: Sequence[int], T_world_scan: FloatArray) -> bool:
    """Whether what one scan alone shows crosses what the others show."""
    some = scans[:: max(1, -(-len(scans) // MAX_SCANS))]
    if len(some) < 2:
        return False
    found = [_alone_crossing_still(views, k, [j for j in some if j != k], T_world_scan) for k in some]
    alone, crossing, still = np.mean(found, axis=0)
    splits = still >= MIN_STILL and 1.0 - still - alone <= MAX_ON_SOME
    return bool(alone >= MIN_ALONE and crossing >= (MIN_CROSSING_BEFORE_STILL if splits else MIN_CROSSING))


def _alone_crossing_still(
    views: Sequence[View], k: int, others: Sequence[int], T_world_scan: FloatArray
) -> tuple[float, float, float]:
    """Shares: of a scan's points its alone; of these, in the mean, across another scan; of all on nearly all others."""
    scan, origin = views[k].scan, views[k].origin
    points, normals = (every_so_many(rows, COMPARED_POINTS) for rows in (scan.points + origin, scan.normals))
    on, crosses = zip(
        *(_on_and_across(views[k], views[j], points, normals, pose.inverse(T_world_scan[j]) @ T_world_scan[k])
          for j in others), strict=True
    )  # fmt: skip
    shared = np.mean(on, axis=0)
    alone, across = shared <= MAX_SHARED, np.mean(crosses, axis=0)
    crossing = float(across[alone].mean()) if alone.any() else 0.0
    return float(alone.mean()), crossing, float(np.mean(shared >= STILL_ON_SHARE))


def _on_and_across(
    view: View, other: View, points: FloatArray, normals: FloatArray, T: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Which points are on another scan, and which cross it."""
    moved, there = pose.apply(T, points), other.scan.points + other.origin
    tree = NeighbourTree(there)
    found, gaps = tree.nearest(moved, 1)
    rows, distances = found.ravel(), gaps.ravel()
    near = ON_SPACINGS * max(view.scan.spacing, other.scan.spacing) + ON_NOISES * max(view.scan.noise, other.scan.noise)
    off = np.abs(np.einsum("ij,ij->i", moved - there[rows], other.scan.normals[rows])) >= MIN_OFF_COS * distances
    turned = np.abs(np.einsum("ij,ij->i", normals @ T[:3, :3].T, other.scan.normals[rows])) < MAX_CROSSING_COS
    is_on = distances < near
    beside = (distances < MAX_OFF_SIZES * size_of(view)) & ~_on_rim(tree, there, rows)
    return is_on, ~is_on & off & turned & beside


def _on_rim(tree: NeighbourTree, points: FloatArray, rows: IntArray) -> BoolArray:
    """Which points have their neighbours to one side."""
    near, _ = tree.nearest(points[rows], RIM_NEIGHBOURS)
    around = points[near] - points[rows][:, None]
    reach = np.linalg.norm(around, axis=2).max(axis=1)
    return np.asarray(np.linalg.norm(around.mean(axis=1), axis=1) >= MAX_RIM_SHARE * reach)
