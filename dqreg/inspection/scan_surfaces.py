"""Surfaces of a scan off its part: deviations of the part, or of something else that leaves it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.inspection.part_islands import of_the_part
from dqreg.inspection.scan_cells import ScanCells

# Points around a cell, its own included, that make it one of a surface; and points beyond a distance that make a
# surface one that runs on beyond it.
SURFACE, LEAVES = 5, 10
# Points of a piece of a surface that says nothing of itself.
PIECE = 25
# Neighbouring cells are of one smooth surface where their planes turn by less than this angle, and the middle of each
# lies within this slope of the other's plane.
SMOOTH_COS, STEP = float(np.cos(np.deg2rad(25.0))), 0.5
# The distance from the part grows along a surface by the sine of the angle between them: a bent part departs from its
# nominal shape by less than the first angle, what stands on it or carries it by more than the second.
CONTINUES_COS, LEAVES_COS = float(np.cos(np.deg2rad(20.0))), float(np.cos(np.deg2rad(45.0)))
# A surface of the part may be farther off than the limit of any other by this factor.
FARTHER = 5.0
# Most of a surface.
MOST = 0.8
# A nominal place is measured where a point of the part has its foot within so many spacings, on the same side.
FOOT = 2.0
# Share of feet on measured places from which a surface stands before the part.
BEFORE = 0.7
# Share of the nominal places behind a surface that were measured, up to which the surface is the face there; and the
# share of the face that it covers, more where some of its points are above another face.
REPLACES, COVERS, MOSTLY = 0.25, 0.25, 0.5
# Surfaces are of one plane within so many sigmas of the noise, or so many spacings; planes that are looked at.
ONE_PLANE, ONE_PLANE_SPACINGS, PLANES = 4.0, 0.5, 8
# Points of a side that are asked which one is nearest.
LOOKED_AT = 200_000


@dataclasses.dataclass(frozen=True)
class Nominal:
    """The target as the points see it."""

    feet: FloatArray  # (n, 3): Closest places
    normals: Callable[[IntArray], FloatArray]  # Of the target at the feet of some rows; 0 where it has none
    faces: Callable[[IntArray], IntArray]  # Number of the face of the part there
    area: Callable[[int], float]  # Of a face


@dataclasses.dataclass(frozen=True)
class Surfaces:
    """What cells of points off the part are of."""

    crowded: BoolArray  # (k,): Of a surface; else the points are outliers
    other: BoolArray  # (k,): Of a surface that is not the part's


def surfaces_of(
    cells: ScanCells,
    off: IntArray,
    points: FloatArray,
    distances: FloatArray,
    nominal: Nominal,
    *,
    limit: float,
    noise: float,
    spacing: float,
    closed: bool,
) -> Surfaces:
    """What the points ``off`` the part are of; ``cells`` hold those.

    ``closed``: no surface of the part goes on beyond the limit.
    """
    crowded = cells.around(cells.counts.astype(np.float64)) >= SURFACE
    flat = cells.flat(noise) & crowded
    patch = cells.patches(_linked(cells, crowded, flat))
    width = max(ONE_PLANE * noise, ONE_PLANE_SPACINGS * spacing)
    scene = Scene(cells, patch, crowded, flat, off, points, distances, nominal, limit, FOOT * spacing, width)
    other = scene.runs_on.copy()
    if not closed:
        other &= ~_continuing(scene)
    other |= _of_something_else(scene, other)
    if not closed:
        other &= ~of_the_part(scene, other)
    return Surfaces(crowded, crowded & other[patch])


def _continuing(scene: Scene) -> BoolArray:
    """Surfaces beyond the limit that are the part's: bent away from its nominal shape, or a face out of place."""
    ends = scene.per_patch(scene.distances[scene.off] > FARTHER * scene.limit) < LEAVES
    candidates = scene.runs_on & ends & scene.is_flat
    found: BoolArray = candidates & scene.turned & scene.attached
    for number in np.flatnonzero(candidates & ~found & scene.half_turned):
        found[number] = scene.replaces_a_face(int(number))
    return found


def _of_something_else(scene: Scene, other: BoolArray) -> BoolArray:
    """Surfaces that end within the limit, but are not the part's, given those that run on beyond it."""
    inner, flat = ~scene.runs_on & (scene.counts > 0), scene.is_flat
    found = np.zeros(scene.count, dtype=bool)
    # What stands before measured places of the part is not the part, however near it is.
    for number in np.flatnonzero(inner & ~scene.attached & flat):
        found[number] = scene.stands_before(int(number))
    leaving = scene.per_patch(scene.facing <= LEAVES_COS) > 0.5 * scene.counts
    # A table is seen through the holes of a part, too.
    found |= inner & leaving & scene.in_planes((other | found) & flat & (scene.counts >= LEAVES))
    # What leaves the part towards another surface, and what is on no smooth one beside it, goes with that.
    found |= inner & (leaving | ~flat) & scene.beside(other | found)
    # What touches nothing and does not look like a face of the part goes with what is nearest.
    pieces = inner & ~found & ~scene.attached & (~flat | ~scene.turned | (scene.counts <= PIECE))
    found |= pieces & scene.nearer_to(other | found, pieces)
    return found


def _linked(cells: ScanCells, crowded: BoolArray, flat: BoolArray) -> BoolArray:
    """Which pairs of neighbouring cells are of one surface: smooth across both, or smooth in neither."""
    one, two = cells.pairs.T
    middles, normals, _ = cells.planes
    between = middles[two] - middles[one]
    length = np.linalg.norm(between, axis=1)
    smooth = np.abs(np.einsum("ij,ij->i", normals[one], normals[two])) >= SMOOTH_COS
    for side in (one, two):
        smooth &= np.abs(np.einsum("ij,ij->i", between, normals[side])) <= STEP * length
    linked: BoolArray = crowded[one] & crowded[two] & (flat[one] == flat[two]) & (smooth | ~flat[one])
    return linked


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
        found: BoolArray = (beyond >= LEAVES) | (beyond > 0.5 * self.counts)
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
        found: BoolArray = self._turned >= MOST * self.counts
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
        return self.share_measured(self.rows_of(number)) >= BEFORE

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
        for number in np.flatnonzero(marked)[np.argsort(-self.counts[marked])][:PLANES]:
            points = self.points[self.rows_of(int(number))]
            middle = points.mean(axis=0)
            normal = np.linalg.svd(np.cov((points - middle).T))[0][:, 2]
            near = np.abs((self.points[self.off] - middle) @ normal) <= self.width
            found |= self.per_patch(near) >= MOST * self.counts
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
        if len(above) <= 0.5 * len(rows) or covers < (COVERS if len(above) >= MOST * len(rows) else MOSTLY):
            return False
        return self.share_measured(above) <= REPLACES
