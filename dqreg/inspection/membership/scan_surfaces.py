"""Surfaces of a scan off its part: deviations of the part, or of something else that leaves it."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.inspection.membership.part_islands import of_the_part
from dqreg.inspection.membership.scan_cells import ScanCells
from dqreg.inspection.membership.scan_scene import (
    LEAVES_COS,
    MIN_LEAVING_POINTS,
    MIN_SURFACE_POINTS,
    ONE_PLANE_SIGMAS,
    ONE_PLANE_SPACINGS,
    PAD_COVERED_SHARE,
    Nominal,
    Scene,
)

# Points of a surface in whose plane others are looked for.
MIN_PLANE_POINTS = 10
# Points of a piece of a surface that says nothing of itself.
MAX_PIECE_POINTS = 25
# Neighbouring cells are of one smooth surface where their planes turn by less than this angle, and the middle of each
# lies within this slope of the other's plane.
SMOOTH_COS, MAX_SLOPE = float(np.cos(np.deg2rad(25.0))), 0.5
# A surface of the part may be farther off than the limit of any other by this factor.
FARTHER_LIMITS = 5.0
# A nominal place is measured where a point of the part has its foot within so many spacings, on the same side.
FOOT_SPACINGS = 2.0


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
    crowded = cells.around(cells.counts.astype(np.float64)) >= MIN_SURFACE_POINTS
    flat = cells.flat(noise) & crowded
    patch = cells.patches(_linked(cells, crowded, flat))
    width = max(ONE_PLANE_SIGMAS * noise, ONE_PLANE_SPACINGS * spacing)
    scene = Scene(cells, patch, crowded, flat, off, points, distances, nominal, limit, FOOT_SPACINGS * spacing, width)
    other = scene.runs_on.copy()
    if not closed:
        other &= ~_continuing(scene)
    other |= _of_something_else(scene, other)
    if not closed:
        other &= ~of_the_part(scene, other)
    return Surfaces(crowded, crowded & other[patch])


def _continuing(scene: Scene) -> BoolArray:
    """Surfaces beyond the limit that are the part's: bent away from its nominal shape, or a face out of place."""
    ends = scene.per_patch(scene.distances[scene.off] > FARTHER_LIMITS * scene.limit) < MIN_LEAVING_POINTS
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
    found |= inner & leaving & scene.in_planes((other | found) & flat & (scene.counts >= MIN_PLANE_POINTS))
    # What leaves the part towards another surface, and what is on no smooth one beside it, goes with that.
    # Between the two lies the edge where they meet.
    for _ in range(2):
        found |= inner & (leaving | ~flat) & scene.beside(other | found)
    # So does what leaves the part beneath another surface, which hides where the two meet: the pad of a clamp.
    asked = inner & leaving & ~found
    covered = scene.per_patch(scene.covered(scene.off_of(asked), scene.off_of(other | found)))
    found |= asked & (covered >= PAD_COVERED_SHARE * scene.counts)
    # What touches nothing and does not look like a face of the part goes with what is nearest.
    pieces = inner & ~found & ~scene.attached & (~flat | ~scene.turned | (scene.counts <= MAX_PIECE_POINTS))
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
        smooth &= np.abs(np.einsum("ij,ij->i", between, normals[side])) <= MAX_SLOPE * length
    linked: BoolArray = crowded[one] & crowded[two] & (flat[one] == flat[two]) & (smooth | ~flat[one])
    return linked
