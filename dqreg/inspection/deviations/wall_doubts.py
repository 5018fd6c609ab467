"""Where a scan without sides may lie on the wrong side of a thin wall: a dent as deep as it is thick looks like that.

The nearest side of a wall is the right one up to half of its thickness. A dent beyond that reads as the other side,
which is then found amid the one that was scanned, and nowhere opposite to it. So the two sides are laid onto the
middle of the wall: a scan of both mixes there, a scan of one holds points of that one alone; but where neighbours are
first all of one and then all of the other, all around, the scan itself does not tell. Where both sides were scanned, a
dent so deep lies in two layers on the other side, as densely as both sides do, and its own side has a gap.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.rigid import pose

# Points that are looked at, and those of them that tell first whether there is a wall: so many on walls are one.
MAX_POINTS, FIRST_POINTS = 100_000, 4_000
MIN_WALL_POINTS = 8
# Thickest wall that is thin, in sizes of the part; its far side looks the other way within 20 degrees.
MAX_THICKNESS_DIAGONALS, OPPOSED_COS = 0.03, float(np.cos(np.deg2rad(20.0)))
# Neighbours on the middle of a wall that make a point one amid a single side.
AMID_NEIGHBOURS = 8
# Between two patches of single sides lies a seam as wide as so many of their radii.
SEAM_RADII = 2.0
# A patch is so many points, beside so many points of seams.
MIN_PATCH_POINTS, MIN_SEAM_POINTS = 5, 5
# Which are so large a share of what is beside it.
MIN_SEAM_SHARE = 0.5
# A patch is in two layers where nearest neighbours differ by so many times what is usual on walls; it is none by chance
# where so many points of the other side are missing.
LAYERED_RATIO, MIN_MISSING_POINTS = 4.0, 5.0


@dataclasses.dataclass(frozen=True, eq=False)
class WallDoubt:
    """A patch of a thin wall that may have been measured on its other side."""

    thickness: float  # Of the wall there, target units: deviations may be wrong by as much
    position: FloatArray  # (3,): A point of the patch, in the caller's target frame

    def moved(self, T: FloatArray) -> WallDoubt:
        """The same with the scan under another pose."""
        return WallDoubt(self.thickness, pose.apply(T, self.position))


def wall_doubts(
    points: FloatArray, feet: FloatArray, normals: FloatArray, surface: MeshSurface, limit: float
) -> tuple[WallDoubt, ...]:
    """Patches of points on the part that may be of the other side of a wall, the largest first. Shapes: (n, 3) each."""
    thickest = min(MAX_THICKNESS_DIAGONALS * surface.diagonal, 2.0 * limit)
    wall = _walls(feet, normals, surface, thickest)
    if len(wall) <= AMID_NEIGHBOURS:
        return ()
    far, _, _ = surface._closest_facing(feet[wall], -normals[wall], OPPOSED_COS, thickest)
    normals, middles = normals[wall], 0.5 * (feet[wall] + far)
    heights = np.einsum("ij,ij->i", points[wall] - feet[wall], normals)
    # Places of the two sides are farther apart than any that belong together.
    patches = _Patches.of(middles, normals, heights, surface.diagonal)
    return tuple(
        WallDoubt(float(np.linalg.norm(far[row] - feet[wall[row]])), points[wall[row]]) for row in patches.doubtful()
    )


def _walls(feet: FloatArray, normals: FloatArray, surface: MeshSurface, thickest: float) -> IntArray:
    """Rows of feet that have another face, opposed, so near."""
    near: list[IntArray] = []
    for first, last in ((0, FIRST_POINTS), (FIRST_POINTS, len(feet))):
        away = surface._closest_facing(feet[first:last], -normals[first:last], OPPOSED_COS, thickest)[1]
        near.append(first + np.flatnonzero(np.isfinite(away)))
        if len(near[0]) < MIN_WALL_POINTS:
            break
    return np.concatenate(near)


@dataclasses.dataclass(frozen=True, eq=False)
class _Patches:
    """Points on the middle of walls, those amid a single side in patches."""

    places: FloatArray  # (m, 6): Place and side, so that the two sides of one place are far apart
    mirrored: FloatArray  # (m, 6): The same on the other side
    radii: FloatArray  # (m,): Of the neighbourhoods
    steps: FloatArray  # (m,): Difference of the heights of a point and of the nearest one of its side
    patch: IntArray  # (m,): -1 amid both sides
    count: int

    @staticmethod
    def of(middles: FloatArray, normals: FloatArray, heights: FloatArray, far: float) -> _Patches:
        """Patches of points that hang together amid their own side."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        found = cKDTree(middles).query(middles, k=[*range(1, AMID_NEIGHBOURS + 2)])
        away, beside = np.asarray(found[0]), np.asarray(found[1], dtype=np.int64)
        alike = np.einsum("ikj,ij->ik", normals[beside], normals) > 0.0
        single = alike.all(axis=1)
        linked = single[:, None] & single[beside]
        one, two = np.repeat(np.arange(len(middles)), linked.sum(axis=1)), beside[linked]
        graph = coo_array((np.ones(len(one), dtype=bool), (one, two)), shape=(len(middles),) * 2)
        count, labels = connected_components(graph, directed=False)
        own, other = (np.hstack([middles, sign * far * normals]) for sign in (1.0, -1.0))
        nearest = beside[np.arange(len(middles)), 1 + np.argmax(alike[:, 1:], axis=1)]
        steps = np.where(alike[:, 1:].any(axis=1), np.abs(heights - heights[nearest]), 0.0)
        return _Patches(own, other, away[:, -1], steps, np.where(single, labels, -1).astype(np.int64), int(count))

    def doubtful(self) -> list[int]:
        """A row of each patch that lies amid the other side, of two amid each other the smaller; or in two layers."""
        single, seam = self.patch >= 0, np.flatnonzero(self.patch < 0)
        if not len(seam) or not single.any():
            return []
        from scipy.spatial import cKDTree

        tree = cKDTree(self.places[single])
        own, other = (self._nearest(tree, sides[seam], seam, single) for sides in (self.places, self.mirrored))
        is_seam = (own >= 0) & (other >= 0)
        sizes = np.bincount(self.patch[single], minlength=self.count)
        # Of both patches beside a seam, and of what else is beside a patch.
        beside, seams = (
            np.bincount(np.concatenate([own[kept & (own >= 0)], other[kept & (other >= 0)]]), minlength=self.count)
            for kept in (np.ones(len(seam), dtype=bool), is_seam)
        )
        found = (sizes >= MIN_PATCH_POINTS) & (seams >= MIN_SEAM_POINTS) & (seams >= MIN_SEAM_SHARE * beside)
        found &= self._smaller(own[is_seam], other[is_seam], sizes)
        found |= (sizes >= MIN_PATCH_POINTS) & self._layered(seam, single)
        numbers = np.flatnonzero(found)
        return [self._middle(int(number)) for number in numbers[np.argsort(-sizes[numbers], kind="stable")]]

    def _nearest(self, tree: Any, places: FloatArray, rows: IntArray, single: BoolArray) -> IntArray:
        """Patch of the nearest point amid its own side, -1 where none is as near as a seam is wide."""
        away, nearest = tree.query(places)
        near = away <= SEAM_RADII * self.radii[rows]
        return np.where(near, self.patch[single][nearest], -1).astype(np.int64)

    def _layered(self, seam: IntArray, single: BoolArray) -> BoolArray:
        """Which patches are in two layers, as dense as the two sides around them together."""
        from scipy.spatial import cKDTree

        away, nearest = cKDTree(self.places[single, :3]).query(self.places[seam, :3])
        near = away <= SEAM_RADII * self.radii[seam]
        rows, around = seam[near], self.patch[single][np.asarray(nearest)[near]]
        usual, found = float(np.median(self.steps)), np.zeros(self.count, dtype=bool)
        inner = np.flatnonzero(single)
        sums = np.bincount(self.patch[inner], self.steps[inner], self.count)
        sizes = np.bincount(self.patch[inner], minlength=self.count)
        for number in np.flatnonzero((sums > LAYERED_RATIO * usual * sizes) & (sizes >= MIN_PATCH_POINTS)):
            own, ring = inner[self.patch[inner] == number], rows[around == number]
            if not len(ring):
                continue
            # Where the other side was not scanned, its share of the points around is missing inside.
            share = float((self.places[ring, 3:] @ self.places[own[0], 3:] > 0.0).mean())
            dense, total = (float(np.median(self.radii[each] ** -2.0)) for each in (own, ring))
            missing = (1.0 - share) * len(own) >= MIN_MISSING_POINTS
            found[number] = missing and dense > 0.5 * (1.0 + share) * total
        return found

    def _smaller(self, own: IntArray, other: IntArray, sizes: IntArray) -> BoolArray:
        """Which patches are not larger than one beside a seam of theirs."""
        found = np.zeros(self.count, dtype=bool)
        found[np.where(sizes[own] <= sizes[other], own, other)] = True
        return found

    def _middle(self, number: int) -> int:
        """Row of the point in the middle of a patch."""
        rows = np.flatnonzero(self.patch == number)
        places = self.places[rows, :3]
        return int(rows[np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1))])


def some_rows(count: int) -> IntArray:
    """Rows of so many that are looked at: drawn, as scanners write lines."""
    if count <= MAX_POINTS:
        # In any order, as the first ones stand for all.
        return np.random.default_rng(0).permutation(count)
    return np.unique(np.random.default_rng(0).integers(count, size=MAX_POINTS))
