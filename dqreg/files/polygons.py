"""Polygons cut into triangles: as a fan where that is right, by clipping ears where a polygon is concave.

trimesh needs another package for this, Open3D and SciPy have none: fans, as every reader makes them, cover a notch.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.files.untrusted import unreadable

# Areas nearer than this, in squared perimeters, are equal: float32 coordinates differ from a plane by about as much.
SAME_AREA = 1e-7
# Clipping ears takes time by the square of the corners.
MAX_CORNERS = 1_000
MAX_SEARCHES = 3
# About two seconds for any file, and as much again for each megabyte.
BASE_SQUARES, SQUARES_PER_BYTE = 10_000_000, 10
# Polygons that are looked at together: what that takes is a hundred times their bytes.
AT_ONCE = 100_000


def fans(lengths: IntArray, corners: IntArray, first: int = 0) -> IntArray:
    """Polygons as fans of triangles around one of their corners. Shapes: lengths (p,), corners (sum of lengths,)."""
    owner, step = _pieces(lengths)
    start, size = (np.cumsum(lengths) - lengths)[owner], lengths[owner]
    places = [start + (first + turn) % size for turn in (np.zeros_like(step), step + 1, step + 2)]
    cut: IntArray = corners[np.stack(places, axis=1)]
    return cut


def triangles(path: Path, vertices: FloatArray, lengths: IntArray, corners: IntArray) -> IntArray:
    """Triangles that cover the polygons and nothing else.

    Shapes: vertices (v, 3), lengths (p,), corners (sum of lengths,).
    """
    if len(lengths) and lengths.min() == lengths.max() == 3:
        return corners.reshape(-1, 3)
    ends, budget = np.cumsum(lengths), _Budget(path)
    pieces = [np.zeros((0, 3), dtype=np.int64)]
    for first in range(0, len(lengths), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        from_, to = ends[some][0] - lengths[first], ends[some][-1]
        pieces.append(_triangles(path, vertices, lengths[some], corners[from_:to], budget))
    return np.concatenate(pieces)


class _Budget:
    """Squares of corners that may be clipped in one file, which is what it costs."""

    def __init__(self, path: Path) -> None:
        self._path, self._left = path, BASE_SQUARES
        with contextlib.suppress(OSError):
            self._left += SQUARES_PER_BYTE * path.stat().st_size

    def spend(self, corners: int) -> None:
        """Count a polygon."""
        self._left -= corners**2
        if self._left < 0:
            raise unreadable(self._path, "too many concave faces of many corners", "triangles, or smaller faces")


def _triangles(path: Path, vertices: FloatArray, lengths: IntArray, corners: IntArray, budget: _Budget) -> IntArray:
    # An index or a position that is invalid is refused with the mesh, in its words.
    valid = len(corners) and corners.min() >= 0 and corners.max() < len(vertices)
    if not valid or lengths.max() <= 3 or not np.isfinite(vertices[corners]).all():
        return fans(lengths, corners)
    cut = [fans(lengths, corners)]
    waiting = np.flatnonzero(_overlapping(vertices, lengths, cut[0]))
    if len(waiting):
        cut = [cut[0][~np.isin(_pieces(lengths)[0], waiting)]]
        lengths, corners = _chosen(lengths, corners, waiting)
        # A concave quadrilateral is right from the next corner on, and so are many others.
        second = fans(lengths, corners, 1)
        still = _overlapping(vertices, lengths, second)
        cut.append(second[~still[_pieces(lengths)[0]]])
        lengths, corners = _chosen(lengths, corners, np.flatnonzero(still))
        for polygon in np.split(corners, np.cumsum(lengths))[:-1]:
            budget.spend(len(polygon))
            cut.append(_clipped(path, vertices, polygon))
    return np.concatenate(cut)


def _pieces(lengths: IntArray) -> tuple[IntArray, IntArray]:
    # Of each triangle of the fans: its polygon, and its number there.
    pieces = np.maximum(lengths - 2, 0)
    owner = np.repeat(np.arange(len(lengths)), pieces)
    return owner, np.arange(len(owner)) - (np.cumsum(pieces) - pieces)[owner]


def _chosen(lengths: IntArray, corners: IntArray, polygons: IntArray) -> tuple[IntArray, IntArray]:
    of_polygon = np.repeat(np.arange(len(lengths)), lengths)
    return lengths[polygons], corners[np.isin(of_polygon, polygons)]


def _overlapping(vertices: FloatArray, lengths: IntArray, cut: IntArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    # Triangles that cover a polygon once have its area together; more means that some cover the outside.
    owner, _ = _pieces(lengths)
    a, b, c = (vertices[cut[:, k]] for k in range(3))
    with np.errstate(over="ignore", invalid="ignore"):
        doubled = np.cross(b - a, c - a)
        normal = np.stack([np.bincount(owner, doubled[:, k], len(lengths)) for k in range(3)], axis=1)
        area = np.linalg.norm(normal, axis=1)
        upright = np.einsum("ij,ij->i", doubled, normal[owner]) / np.where(area > 0.0, area, 1.0)[owner]
        covered = np.bincount(owner, np.abs(upright), len(lengths))
        extent = np.bincount(owner, np.linalg.norm(b - a, axis=1) + np.linalg.norm(c - b, axis=1), len(lengths))
        wrong = (covered > area + SAME_AREA * extent**2) & (lengths > 3)
    return np.asarray(wrong)


def _clipped(path: Path, vertices: FloatArray, polygon: IntArray) -> IntArray:
    count = len(polygon)
    if count > MAX_CORNERS:
        raise unreadable(path, f"a concave face of {count} corners", f"at most {MAX_CORNERS}, or triangles")
    found: IntArray = polygon[np.array(_ears(_flattened(vertices[polygon])))]
    if _overlapping(vertices, np.array([count]), found)[0]:
        raise unreadable(path, f"a face of {count} corners that crosses itself", "faces whose edges do not cross")
    return found


def _ears(flat: FloatArray) -> list[tuple[int, int, int]]:
    count, searches = len(flat), 0
    before, after = np.roll(np.arange(count), 1), np.roll(np.arange(count), -1)
    bend = _bend(flat, before, np.arange(count), after)
    left, waiting, cut = set(range(count)), list(range(count)), list[tuple[int, int, int]]()
    while len(left) > 3:
        tip = waiting.pop() if waiting else min(left, key=lambda k: abs(float(bend[k])))
        # A cut changes its neighbours only, but for rounding: then all are searched again, and if that is in vain, the
        # straightest corner costs least. The area tells whether it was right.
        forced = not waiting and searches > MAX_SEARCHES
        if tip not in left or not (forced or _is_ear(flat, bend, before[tip], tip, after[tip])):
            if not waiting:
                waiting, searches = list(left), searches + 1
            continue
        one, other = int(before[tip]), int(after[tip])
        cut.append((one, tip, other))
        left.remove(tip)
        after[one], before[other], bend[tip] = other, one, np.inf
        bend[[one, other]] = _bend(flat, before[[one, other]], np.array([one, other]), after[[one, other]])
        waiting += [one, other]
    last = min(left)
    return [*cut, (int(before[last]), last, int(after[last]))]


def _flattened(points: FloatArray) -> FloatArray:
    # In the plane of the polygon, turning left.
    points = points - points[0]
    normal = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat: FloatArray = points[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return flat if normal[axis] > 0.0 else flat[:, ::-1]


def _bend(flat: FloatArray, before: IntArray, tip: IntArray, after: IntArray) -> FloatArray:
    (ax, ay), (bx, by) = (flat[tip] - flat[before]).T, (flat[after] - flat[tip]).T
    return np.asarray(ax * by - ay * bx)


def _is_ear(flat: FloatArray, bend: FloatArray, before: int, tip: int, after: int) -> bool:
    if not 0.0 < bend[tip] < np.inf:
        return False
    corners = flat[[before, tip, after]]
    others = flat[bend <= 0.0]
    inside = np.ones(len(others), dtype=np.bool_)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        gap = others - a
        inside &= (b[0] - a[0]) * gap[:, 1] - (b[1] - a[1]) * gap[:, 0] >= 0.0
    # A corner that two edges share, as at the bridge to a hole, stands in nobody's way.
    shared = (others[:, None] == corners).all(axis=2).any(axis=1)
    return not (inside & ~shared).any()
