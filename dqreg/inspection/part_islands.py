"""Surfaces of a scan that leave the part's nominal surface beyond the limit and are the part's: lids and islands."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.inspection.scan_scene import Scene

# Points on the part go on smoothly where they leave the tangent plane of the surface beside them by less than this
# slope, and turn by less than the angle.
SLOPE, SMOOTH_COS = 0.35, float(np.cos(np.deg2rad(20.0)))
# A point on a face has its foot beside it by less than this share of the distance at which feet are of one place.
BESIDE = 0.1
# Directions about a surface, and the share of them in which the part goes on smoothly that makes it a lid of the part,
# or an island amid one of its faces: beside the part it does so in half of them at most.
SECTORS, ENCLOSED = 24, 0.6
# A lid is no wider than so many limits: half of the part.
LARGEST = 10.0
# Points of an island at least, and how far it goes, in limits; beyond that another object stands on the part.
ISLAND, WIDE = 25, 5.0
# Share of an island's points that stand above a face of the part, not beside one.
ABOVE_COS, ABOVE = float(np.cos(np.deg2rad(20.0))), 0.8
# Share of the places behind an island that were measured, from which it is before the part and does not stand on it.
SHADOW = 0.7


def of_the_part(scene: Scene, other: BoolArray) -> BoolArray:
    """Patches among those of other surfaces that are the part's all the same."""
    if not other.any():
        return other
    lids = _lids(scene, other & scene.is_flat & (scene.counts >= ISLAND))
    return lids | _islands(scene, other & ~lids)


def _lids(scene: Scene, asked: BoolArray) -> BoolArray:
    """Patches around which a face of the part, as it was scanned, goes on smoothly."""
    found = np.zeros(scene.count, dtype=bool)
    mine = np.flatnonzero(asked[scene.patch] & scene.crowded)
    wide = _extents(scene.cells.planes[0][mine], scene.patch[mine], scene.count) > LARGEST * scene.limit
    mine = mine[~wide[scene.patch[mine]]]
    if len(mine):
        rows, patch = _going_on(scene, mine)
        many = np.flatnonzero(np.bincount(patch, minlength=scene.count) >= SECTORS * ENCLOSED)
        for number in many:
            share = _enclosed(scene.points[scene.rows_of(int(number))], scene.points[rows[patch == number]])
            found[number] = share >= ENCLOSED
    return found


def _going_on(scene: Scene, mine: IntArray) -> tuple[IntArray, IntArray]:
    """Rows of the scan on faces of the part that are tangent to the surface in a cell beside them, and its patch."""
    middles, normals, _ = scene.cells.planes
    keys, owners = scene.cells.beyond(mine)
    order = np.argsort(keys, kind="stable")
    keys, owners = keys[order], owners[order]
    rows, own = scene.cells.rows_in(scene.points, scene.on, np.unique(keys))
    # Each point with all the surfaces beside its cell.
    low, high = np.searchsorted(keys, own), np.searchsorted(keys, own, side="right")
    times = high - low
    beside = owners[np.repeat(low - np.cumsum(times) + times, times) + np.arange(times.sum())]
    points, nominal = scene.points[rows], scene.nominal.normals(rows)
    offsets = points - scene.nominal.feet[rows]
    aside = np.linalg.norm(offsets - np.einsum("ij,ij->i", offsets, nominal)[:, None] * nominal, axis=1)
    of = np.repeat(np.arange(len(rows)), times)
    between = points[of] - middles[beside]
    smooth = np.abs(np.einsum("ij,ij->i", nominal[of], normals[beside])) >= SMOOTH_COS
    smooth &= np.abs(np.einsum("ij,ij->i", between, normals[beside])) <= SLOPE * np.linalg.norm(between, axis=1)
    smooth &= (aside <= BESIDE * scene.near)[of]
    each = np.unique(np.column_stack([rows[of[smooth]], scene.patch[beside[smooth]]]), axis=0)
    return each[:, 0], each[:, 1]


def _enclosed(points: FloatArray, around: FloatArray) -> float:
    """Share of the directions in which points lie around others, farther out than those."""
    middle = points.mean(axis=0)
    plane = np.linalg.svd(np.cov((points - middle).T))[0][:, :2]
    inner, outer = (np.zeros(SECTORS) for _ in range(2))
    for places, farthest in ((points, inner), (around, outer)):
        x, y = ((places - middle) @ plane).T
        sector = np.floor((np.arctan2(y, x) / (2.0 * np.pi) + 0.5) * SECTORS).astype(np.int64) % SECTORS
        np.maximum.at(farthest, sector, np.hypot(x, y))
    return float(np.mean(outer > inner))


def _islands(scene: Scene, asked: BoolArray) -> BoolArray:
    """Patches of what stands on the part: small, above its faces, and amid one of them, see `_stands_on`."""
    marked = asked[scene.patch] & scene.crowded
    one, two = scene.cells.pairs.T
    island = scene.cells.patches(marked[one] & marked[two])
    count, mine = int(island.max()) + 1, marked[scene.cells.cell]
    rows, of = scene.off[mine], island[scene.cells.cell][mine]
    sizes = np.bincount(of, minlength=count)
    offsets = scene.points[rows] - scene.nominal.feet[rows]
    cosines = np.abs(np.einsum("ij,ij->i", offsets, scene.nominal.normals(rows))) / scene.distances[rows]
    above = np.bincount(of, weights=cosines >= ABOVE_COS, minlength=count)
    found = (sizes >= ISLAND) & (above >= ABOVE * sizes)
    found &= _extents(scene.points[rows], of, count) <= WIDE * scene.limit
    touching = np.bincount(island, weights=marked & scene.beside_part, minlength=count) > 0
    for number in np.flatnonzero(found):
        found[number] = _stands_on(scene, rows[of == number], touches=bool(touching[number]))
    patches = scene.any_of_patch(found[island] & marked)
    if not patches.any():
        return patches
    # A table is seen through the holes of a part.
    return asked & patches & ~scene.in_planes(asked & ~patches & scene.is_flat & (scene.counts >= ISLAND))


def _stands_on(scene: Scene, rows: IntArray, *, touches: bool) -> bool:
    """Whether an island stands amid a face of the part that was scanned around it: a table or clamp is beside one.

    The sides of a pin are not seen from above: its shadow on the part is the only place that was not measured.
    """
    if not (touches or 0.0 < scene.share_measured(rows) < SHADOW):
        return False
    feet, normal = scene.nominal.feet[rows], scene.nominal.normals(rows).mean(axis=0)
    within = np.abs(scene.nominal.feet[scene.rows_on] - feet.mean(axis=0)).max(axis=1) <= np.ptp(feet, axis=0).max()
    around = scene.rows_on[within]
    around = around[scene.nominal.normals(around) @ normal >= SMOOTH_COS * np.linalg.norm(normal)]
    return len(around) > 0 and _enclosed(feet, scene.nominal.feet[around]) >= ENCLOSED


def _extents(points: FloatArray, of: IntArray, count: int) -> FloatArray:
    """Longest side of the box about each island."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, of, points)
    np.maximum.at(high, of, points)
    return np.asarray((high - low).max(axis=1))
