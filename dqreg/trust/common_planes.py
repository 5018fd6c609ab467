"""Two clouds that have three planes in common at most: where the faces in them end."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.spacing import measure_spacing
from dqreg.trust.overlap import Overlap

# Planes that fix a pose and leave nothing to check it by; the share of the common places that they hold, and the share
# below which a plane is none; places that are tried as one of it.
PLANES, ALL, LEAST_SHARE, TRIED = 3, 0.95, 0.02, 30
# A plane: normals within this angle, and distances within this share of the size, or so many times the noise.
SAME_COS, WITHIN, NOISY = np.cos(np.deg2rad(8.0)), 5e-3, 3.0
# Neighbours of a point that lie in the plane with it, as a share of so many; distances, in spacings, beyond which a
# point has none of the other cloud beside it; points in the planes without which nothing is said.
NEIGHBOURS, FLAT, GAP, FEWEST = 8, 0.9, 4.0, 100
# Points of a cloud of which its spacing is measured.
SAMPLE = 1_000


def ends_apart(overlap: Overlap, placed: FloatArray, fixed: FloatArray, size: float) -> float:
    """Share of the faces in the common planes that reach beyond the other cloud, of that of two which has less of it.

    The corner of any part fits the corner of any other; where its faces end, parts differ. What one view alone shows of
    a face may be hidden from the other; that each shows what the other does not is another part. NaN where the clouds
    have more than three planes in common, or other shapes. Shapes: placed (n, 3), fixed (m, 3).
    """
    within = max(WITHIN * size, NOISY * float(np.median(overlap.noise)))
    planes = _planes(overlap, within)
    if planes is None:
        return np.nan
    trees = NeighbourTree(placed), NeighbourTree(fixed)
    gap = GAP * max(measure_spacing(tree, points, SAMPLE) for tree, points in zip(trees, (placed, fixed), strict=True))
    one = _beyond(placed, trees[0], fixed, planes, within, gap)
    return float(np.minimum(one, _beyond(fixed, trees[1], placed, planes, within, gap)))


def _planes(overlap: Overlap, within: float) -> list[tuple[FloatArray, FloatArray]] | None:
    """Points and normals of the planes that hold all common places; None where those are more, or no planes."""
    left = np.ones(len(overlap.points), dtype=bool)
    planes = []
    for _ in range(PLANES):
        rows = np.flatnonzero(left)
        if len(rows) < LEAST_SHARE * len(left):
            break
        held = max((_held(overlap, k, left, within) for k in rows[sample_rows(len(rows), TRIED)]), key=np.count_nonzero)
        points = overlap.points[held]
        middle = points.mean(axis=0)
        planes.append((middle, np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0]))
        left &= ~held
    return planes if np.count_nonzero(left) <= (1.0 - ALL) * len(left) else None


def _held(overlap: Overlap, k: int, left: BoolArray, within: float) -> BoolArray:
    """Which places, (n,), of those left lie in the plane of one."""
    normal = overlap.normals[k]
    aside = np.abs((overlap.points - overlap.points[k]) @ normal)
    held: BoolArray = left & (aside < within) & (np.abs(overlap.normals @ normal) > SAME_COS)
    return held


def _beyond(
    points: FloatArray,
    tree: NeighbourTree,
    others: FloatArray,
    planes: list[tuple[FloatArray, FloatArray]],
    within: float,
    gap: float,
) -> float:
    """Share of a cloud's faces in some planes that has no point of another one beside it; NaN for few points."""
    inside = beyond = 0
    for middle, normal in planes:
        near, theirs = (np.abs((some - middle) @ normal) < within for some in (points, others))
        rows = np.flatnonzero(near)
        if not len(rows) or not theirs.any():
            continue
        # Faces that cross the plane are no part of it.
        rows = rows[near[tree.nearest(points[rows], NEIGHBOURS)[0]].mean(axis=1) > FLAT]
        apart = NeighbourTree(others[theirs]).nearest(points[rows], 1)[1][:, 0]
        inside, beyond = inside + len(rows), beyond + int(np.count_nonzero(apart > gap))
    return beyond / inside if inside >= FEWEST else np.nan
