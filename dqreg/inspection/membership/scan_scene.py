"""Patches of a scan off its part, and what is known of each."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.inspection.membership.scan_cells import ScanCells

# Points around a cell, its own included, that make it one of a surface; and points beyond a distance that make a
# surface one that runs on beyond it.
MIN_SURFACE_POINTS, MIN_LEAVING_POINTS = 5, 10
# The distance from the part grows along a surface by the sine of the angle between them: a bent part departs from its
# nominal shape by less than the first angle, what stands on it or carries it by more than the second.
CONTINUES_COS, LEAVES_COS = float(np.cos(np.deg2rad(20.0))), float(np.cos(np.deg2rad(45.0)))
# Most of a surface.
MOST_SHARE = 0.8
# Share of the places behind a surface that were measured, from which it stands before the part, not on it.
BEFORE_PART_SHARE = 0.7
# Share of the nominal places behind a surface that were measured, up to which the surface is the face there.
MAX_MEASURED_SHARE = 0.25
# Share of that face that it covers, more where some of its points are above another face.
MIN_COVERED_SHARE, MIN_COVERED_SHARE_OF_TWO = 0.25, 0.5
# Of a face that is out of place as a whole, so small a share was measured in its place: points of the faces beside it,
# which are single ones in a place.
MAX_KEPT_SHARE, SINGLE_POINTS = 0.1, 1
# Surfaces are of one plane within so many sigmas of the noise, or so many spacings.
ONE_PLANE_SIGMAS, ONE_PLANE_SPACINGS = 4.0, 0.5
# Planes that are looked at, the largest ones.
MAX_PLANES = 8
# Share of the points of a surface above which another object lies, from which it is that one's pad.
PAD_COVERED_SHARE = 0.5
# Points of a side that are asked which one is nearest.
LOOKED_AT = 200_000


@dataclasses.dataclass(frozen=True)
class Nominal:
    """The target as the points see it."""

    feet: FloatArray  # (n, 3): Closest places
    normals: Callable[[IntArray], FloatArray]  # Of the target at the feet of some rows; 0 where it has none
    faces: Callable[[IntArray], IntArray]  # Number of the face of the part there
    area: Callable[[int], float]  # Of a face
    corners: FloatArray  # (m, 3): All of it lies between these


@dataclasses.dataclass(eq=False)
class Scene:
    """Patches of cells off the part, and what is known of each."""

    cells: ScanCells
    patch: IntArray  # (k,): Of each cell
    crowded: BoolArray
    flat: BoolArray
    off: IntArray  # Rows of the scan that the cells hold
    points: FloatArray
    distances: FloatArray
    nominal: Nominal
    limit: float
    near: float  # Feet so near to each other are of one place
    width: float  # Points so near to a plane are in it

    def __post_init__(self) -> None:
        self.count = int(self.patch.max(initial=-1)) + 1
        self.counts = self.per_patch(np.ones(len(self.off)))
        self.is_flat = self.any_of_patch(self.flat)

    @cached_property
    def runs_on(self) -> BoolArray:
        """Patches that go on beyond the limit."""
        beyond = self.per_patch(self.distances[self.off] > self.limit)
        found: BoolArray = (beyond >= MIN_LEAVING_POINTS) | (beyond > 0.5 * self.counts)
        return found

    def per_patch(self, values: FloatArray | BoolArray) -> FloatArray:
        """Sum over the points of each patch that is crowded."""
        sums = self.cells.sums(np.asarray(values, dtype=np.float64)) * self.crowded
        return np.bincount(self.patch, weights=sums, minlength=self.count).astype(np.float64)

    def any_of_patch(self, marked: BoolArray) -> BoolArray:
        """Patches of which a crowded cell is marked."""
        found = np.zeros(self.count, dtype=bool)
        found[self.patch[marked & self.crowded]] = True
        return found

    @cached_property
    def turned(self) -> BoolArray:
        """Patches that face the part like one of its own faces."""
        found: BoolArray = self._turned >= MOST_SHARE * self.counts
        return found

    @cached_property
    def half_turned(self) -> BoolArray:
        """Patches of which most points do; those above the foot of a wall have their feet on the wall."""
        found: BoolArray = self._turned > 0.5 * self.counts
        return found

    @cached_property
    def _turned(self) -> FloatArray:
        return self.per_patch(self.facing >= CONTINUES_COS)

    def beside(self, marked: BoolArray) -> BoolArray:
        """Patches that touch one of those marked."""
        return self.any_of_patch(self.cells.beside(marked[self.patch] & self.crowded))

    @cached_property
    def facing(self) -> FloatArray:
        """Cosine of the angle between the surface at each point and the part's; 0 where it is not known."""
        offsets = self.points[self.off] - self.nominal.feet[self.off]
        normals = self.cells.planes[1][self.cells.cell]
        cosines = np.abs(np.einsum("ij,ij->i", offsets, normals)) / self.distances[self.off]
        return np.where(self.flat[self.cells.cell], cosines, 0.0)

    @cached_property
    def on(self) -> BoolArray:
        """Whether each row of the scan lies on the part's nominal surface."""
        on = np.ones(len(self.points), dtype=bool)
        on[self.off] = False
        return on

    @cached_property
    def rows_on(self) -> IntArray:
        """Rows of the scan on the part's nominal surface."""
        return np.flatnonzero(self.on)

    @cached_property
    def beside_part(self) -> BoolArray:
        """Cells beside which points lie on the part's nominal surface."""
        return self.cells.near(self.points, self.on)

    @cached_property
    def attached(self) -> BoolArray:
        """Patches of which a cell is such."""
        return self.any_of_patch(self.beside_part)

    def rows_of(self, number: int) -> IntArray:
        """Rows of the scan of a patch."""
        found: IntArray = self.off[((self.patch == number) & self.crowded)[self.cells.cell]]
        return found

    def stands_before(self, number: int) -> bool:
        """Whether the nominal places behind a surface were measured too."""
        return self.share_measured(self.rows_of(number)) >= BEFORE_PART_SHARE

    def share_measured(self, rows: IntArray) -> float:
        """Share of the nominal places behind some rows of the scan that were measured too."""
        if not len(self.rows_on):
            return 0.0
        away, _ = self._measured.query(self._sided(rows), distance_upper_bound=self.near)
        return float(np.isfinite(away).mean())

    @cached_property
    def _measured(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self._sided(self.rows_on))

    def _sided(self, rows: IntArray) -> FloatArray:
        # A foot on the other side of a thin wall is another place.
        return np.hstack([self.nominal.feet[rows], 2.0 * self.near * self.nominal.normals(rows)])

    def in_planes(self, marked: BoolArray) -> BoolArray:
        """Patches that lie in the plane of one of those marked, the largest ones."""
        found = np.zeros(self.count, dtype=bool)
        for number in np.flatnonzero(marked)[np.argsort(-self.counts[marked])][:MAX_PLANES]:
            points = self.points[self.rows_of(int(number))]
            middle = points.mean(axis=0)
            normal = np.linalg.svd(np.cov((points - middle).T))[0][:, 2]
            near = np.abs((self.points[self.off] - middle) @ normal) <= self.width
            found |= self.per_patch(near) >= MOST_SHARE * self.counts
        return found

    def nearer_to(self, other: BoolArray, pieces: BoolArray) -> BoolArray:
        """Patches of which most points lie nearer to other surfaces than to the part."""
        from scipy.spatial import cKDTree

        away = self.off[(self.crowded & other[self.patch])[self.cells.cell]]
        asked = np.flatnonzero((self.crowded & pieces[self.patch])[self.cells.cell])
        nearer = np.zeros(len(self.off), dtype=bool)
        if len(asked) and len(away):
            points = self.points[self.off[asked]]
            to_part, to_other = (
                cKDTree(self.points[rows[:: -(-len(rows) // LOOKED_AT)]]).query(points)[0] if len(rows) else np.inf
                for rows in (self.rows_on, away)
            )
            nearer[asked] = to_other < to_part
        found: BoolArray = self.per_patch(nearer) > 0.5 * self.counts
        return found

    def off_of(self, patches: BoolArray) -> BoolArray:
        """Which of the points off the part are of some patches."""
        found: BoolArray = (self.crowded & patches[self.patch])[self.cells.cell]
        return found

    def covered(self, asked: BoolArray, others: BoolArray) -> BoolArray:
        """Which points off the part, of those asked, have one of the others above: of the same place, farther off."""
        from scipy.spatial import cKDTree

        found, mine, away = np.zeros(len(self.off), dtype=bool), np.flatnonzero(asked), np.flatnonzero(others)
        if not len(mine) or not len(away):
            return found
        feet, width = self.nominal.feet[self.off], 2.0 * self.near
        low, high = feet[mine].min(axis=0) - width, feet[mine].max(axis=0) + width
        away = away[((feet[away] >= low) & (feet[away] <= high)).all(axis=1)]
        if len(away):
            tree = cKDTree(self._sided(self.off[away]))
            near, nearest = tree.query(self._sided(self.off[mine]), distance_upper_bound=width)
            there = np.isfinite(near)
            above, below = self.off[away[np.asarray(nearest)[there]]], self.off[mine[there]]
            sides = np.einsum("ij,ij->i", *(self.points[rows] - self.nominal.feet[rows] for rows in (above, below)))
            found[mine[there]] = (sides > 0.0) & (self.distances[above] > self.distances[below])
        return found

    def replaces_a_face(self, number: int) -> bool:
        """Whether a surface is what was measured of the face of the part behind it."""
        rows = self.rows_of(number)
        faces = self.nominal.faces(rows)
        behind = np.bincount(faces)
        face = int(behind.argmax())
        above = rows[faces == face]
        places = np.unique(np.floor(self.nominal.feet[above] / self.near), axis=0)
        covers = len(places) * self.near**2 / self.nominal.area(face)
        # A surface above two faces replaces one of them where it covers more of it.
        needed = MIN_COVERED_SHARE if len(above) >= MOST_SHARE * len(rows) else MIN_COVERED_SHARE_OF_TWO
        if len(above) <= 0.5 * len(rows) or covers < needed:
            return False
        if self.share_measured(above) > MAX_MEASURED_SHARE:
            return False
        # A face is out of place as a whole: where some of it was measured in its place, this one is another object's.
        own = self.rows_on[self.nominal.faces(self.rows_on) == face]
        points = np.unique(np.floor(self.nominal.feet[own] / self.near), axis=0, return_counts=True)[1]
        kept = int(np.count_nonzero(points > SINGLE_POINTS))
        return kept <= MAX_KEPT_SHARE * (kept + len(places))
