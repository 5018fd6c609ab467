"""Surfaces of a scan that leave the part's nominal surface beyond the limit and are the part's: lids and islands."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.inspection.membership.scan_scene import BEFORE_PART_SHARE, LEAVES_COS, PAD_COVERED_SHARE, Scene

# Points on the part go on smoothly where they leave the tangent plane of the surface beside them by less than this
# slope, and turn by less than the angle.
MAX_SLOPE, SMOOTH_COS = 0.35, float(np.cos(np.deg2rad(20.0)))
# A point on a face has its foot beside it by less than this share of the distance at which feet are of one place.
MAX_ASIDE_SHARE = 0.1
# Directions about a surface, and the share of them in which the part goes on smoothly that makes it a lid of the part,
# or an island amid one of its faces: beside the part it does so in half of them at most.
SECTOR_COUNT, MIN_ENCLOSED_SHARE = 24, 0.6
# Share in which it does so beside one side of a patch, and how far such patches are apart about an edge, in cells.
MIN_BORDERED_SHARE, EDGE_GAP_CELLS = 0.25, 3.0
# Share of the directions in which the part lies around what closes a bore; around a notch it is three quarters.
MIN_CLOSED_SHARE = 0.8
# A lid is no wider than so many limits: half of the part.
MAX_LID_LIMITS = 10.0
# Points of an island at least, and how far it goes, in limits; beyond that another object stands on the part.
MIN_ISLAND_POINTS, MAX_ISLAND_LIMITS = 25, 5.0
# Faces beneath an island along whose normals it is looked at, and how far around it, in radii of it.
TRIED_NORMALS, AROUND_RADII = 3, 3.0


def of_the_part(scene: Scene, other: BoolArray) -> BoolArray:
    """Patches among those of other surfaces that are the part's all the same."""
    if not other.any():
        return other
    lids = _lids(scene, other & scene.is_flat & (scene.counts >= MIN_ISLAND_POINTS))
    return lids | _islands(scene, other & ~lids)


def _lids(scene: Scene, asked: BoolArray) -> BoolArray:
    """Patches around which a face of the part, as it was scanned, goes on smoothly; and corners of such."""
    shares = np.zeros(scene.count)
    mine = np.flatnonzero(asked[scene.patch] & scene.crowded)
    wide = _extents(scene.cells.planes[0][mine], scene.patch[mine], scene.count) > MAX_LID_LIMITS * scene.limit
    mine = mine[~wide[scene.patch[mine]]]
    if len(mine):
        rows, patch = _going_on(scene, mine)
        for number in np.flatnonzero(np.bincount(patch, minlength=scene.count) >= SECTOR_COUNT * MIN_BORDERED_SHARE):
            points = scene.points[scene.rows_of(int(number))]
            around = scene.points[rows[patch == number]]
            plane, middle = _plane_of(points)[:, :2], points.mean(axis=0)
            shares[number] = _enclosed((points - middle) @ plane, (around - middle) @ plane)
    return (shares >= MIN_ENCLOSED_SHARE) | _corners(scene, np.flatnonzero(shares >= MIN_BORDERED_SHARE))


def _corners(scene: Scene, bordered: IntArray) -> BoolArray:
    """Of patches that continue a face of the part on a side, those that meet one that continues another face.

    A jaw may be flush with one face, what fills a corner is with all of them.
    """
    from scipy.spatial import cKDTree

    found = np.zeros(scene.count, dtype=bool)
    points = [scene.points[scene.rows_of(int(number))] for number in bordered]
    normals = [_plane_of(each)[:, 2] for each in points]
    for one, two in combinations(range(len(bordered)), 2):
        if abs(normals[one] @ normals[two]) <= LEAVES_COS:
            near = cKDTree(points[one]).query(points[two], distance_upper_bound=EDGE_GAP_CELLS * scene.cells.width)[0]
            found[bordered[[one, two]]] |= bool(np.isfinite(near).any())
    return found


def _plane_of(points: FloatArray) -> FloatArray:
    """Axes of some points in columns, the normal of their plane last."""
    return np.asarray(np.linalg.svd(np.cov((points - points.mean(axis=0)).T))[0])


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
    smooth &= np.abs(np.einsum("ij,ij->i", between, normals[beside])) <= MAX_SLOPE * np.linalg.norm(between, axis=1)
    smooth &= (aside <= MAX_ASIDE_SHARE * scene.near)[of]
    each = np.unique(np.column_stack([rows[of[smooth]], scene.patch[beside[smooth]]]), axis=0)
    return each[:, 0], each[:, 1]


def _enclosed(points: FloatArray, around: FloatArray, farther: float = 0.0) -> float:
    """Share of the directions in a plane in which points lie around others, farther out. Shapes: (n, 2), (m, 2)."""
    inner, outer = (np.zeros(SECTOR_COUNT) for _ in range(2))
    for places, farthest in ((points, inner), (around, outer)):
        x, y = places.T
        sector = np.floor((np.arctan2(y, x) / (2.0 * np.pi) + 0.5) * SECTOR_COUNT).astype(np.int64) % SECTOR_COUNT
        np.maximum.at(farthest, sector, np.hypot(x, y))
    return float(np.mean(outer > inner + farther))


def _islands(scene: Scene, asked: BoolArray) -> BoolArray:
    """Patches of what stands on the part: small, amid it, and under nothing that does not, see `_stands_on`."""
    marked = asked[scene.patch] & scene.crowded
    one, two = scene.cells.pairs.T
    island = scene.cells.patches(marked[one] & marked[two])
    count, mine = int(island.max()) + 1, marked[scene.cells.cell]
    of = np.where(mine, island[scene.cells.cell], count)
    sizes = np.bincount(of, minlength=count + 1)[:count]
    rows = scene.off[mine]
    # As far off where its sides were not seen as where they were.
    going, farthest = _extents(scene.points[rows], of[mine], count), np.zeros(count)
    np.maximum.at(farthest, of[mine], scene.distances[rows])
    small = np.maximum(going, farthest) <= MAX_ISLAND_LIMITS * scene.limit
    found = (sizes >= MIN_ISLAND_POINTS) & small
    touching = np.bincount(island, weights=marked & scene.beside_part, minlength=count) > 0
    for number in np.flatnonzero(found):
        found[number] = _stands_on(scene, rows[of[mine] == number], touches=bool(touching[number]))
    standing = np.append(found, False)[of]
    under = np.bincount(of, weights=scene.covered(standing, mine & ~standing), minlength=count + 1)[:count]
    found &= under < PAD_COVERED_SHARE * sizes
    patches = scene.any_of_patch(found[island] & marked)
    if not patches.any():
        return patches
    # A table is seen through the holes of a part.
    return asked & patches & ~scene.in_planes(asked & ~patches & scene.is_flat & (scene.counts >= MIN_ISLAND_POINTS))


def _stands_on(scene: Scene, rows: IntArray, *, touches: bool) -> bool:
    """Whether an island stands amid the part, as it was scanned around it: a table or clamp is beside one.

    The sides of a pin are not seen from above: its shadow on the part is the only place that was not measured.
    """
    if not (touches or 0.0 < scene.share_measured(rows) < BEFORE_PART_SHARE):
        return False
    normals, faces = scene.nominal.normals(rows), scene.nominal.faces(rows)
    for face in np.argsort(-np.bincount(faces))[:TRIED_NORMALS]:
        if (faces == face).any() and _amid(scene, rows, normals[faces == face].mean(axis=0)):
            return True
    return _closes(scene, rows)


def _closes(scene: Scene, rows: IntArray) -> bool:
    """Whether the part lies all around a surface, in its plane, and on both sides of it: a table is beneath it."""
    points = scene.points[rows]
    axes, middle = _plane_of(points), points.mean(axis=0)
    across = (points - middle) @ axes[:, :2]
    if _enclosed(across, (scene.nominal.feet[rows] - middle) @ axes[:, :2]) < MIN_CLOSED_SHARE:
        return False
    corners = (scene.nominal.corners - middle) @ axes
    # The plane is as uncertain far off as that is in radii of the surface.
    radius = max(np.hypot(*across.T).max(), scene.near)
    beyond = scene.width * np.maximum(np.hypot(*corners[:, :2].T) / radius, 1.0)
    return bool((corners[:, 2] > beyond).any() and (corners[:, 2] < -beyond).any())


def _amid(scene: Scene, rows: IntArray, along: FloatArray) -> bool:
    """Whether the part lies around an island, looked at along a normal of it."""
    if np.linalg.norm(along) < SMOOTH_COS:
        return False
    plane = np.linalg.svd(along[None])[2][1:].T
    middle = scene.points[rows].mean(axis=0)
    island = (scene.points[rows] - middle) @ plane
    part = (scene.points[scene.rows_on] - middle) @ plane
    part = part[np.hypot(*part.T) <= AROUND_RADII * np.hypot(*island.T).max() + scene.near]
    return len(part) > 0 and _enclosed(island, part, scene.near) >= MIN_ENCLOSED_SHARE


def _extents(points: FloatArray, of: IntArray, count: int) -> FloatArray:
    """Longest side of the box about each island."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, of, points)
    np.maximum.at(high, of, points)
    return np.asarray((high - low).max(axis=1))
