"""What the page draws: thinned points, triangles by face, lighter surfaces for a view that moves; in 16-bit steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg._open3d import load_open3d
from dqreg.geometry import Mesh, MeshSurface, PointCloud
from dqreg.geometry.morton import morton_order
from dqreg.report.view3d import COORDINATE_STEPS, fewer_triangles, sharp_edges
from dqreg.studio.drawing import DrawnFrame

# What is drawn at most.
MAX_POINTS, MAX_POINTS_OFF_PART = 200_000, 40_000
MAX_TRIANGLES = 120_000
# Triangles of the surfaces that stand for the part while the view moves, each where there are more than twice as many.
MOVING_TRIANGLES = (12_000, 3_000)
# Points that a normal is estimated of for the light, and where that comes from.
LIGHT_NEIGHBOURS, LIGHT_DIRECTION = 12, np.array([0.36, -0.48, 0.8])


def rows_to_draw(points: FloatArray, on: BoolArray) -> tuple[IntArray, IntArray]:
    """Rows of the points that are drawn: those that count, and the others; each in an order that thins evenly."""
    return _spread(points, np.flatnonzero(on), MAX_POINTS), _spread(points, np.flatnonzero(~on), MAX_POINTS_OFF_PART)


def cloud_payload(
    points: FloatArray, frame: DrawnFrame, rows: tuple[IntArray, IntArray]
) -> tuple[dict[str, Any], bytes]:
    """Points to draw: what the page must know, and the coordinates, first of those that count."""
    known, steps = _quantised(frame.to_drawn(points[np.concatenate(rows)]))
    return {**known, "kind": "cloud", "on": len(rows[0]), "off": len(rows[1]), "total": len(points)}, steps


def shades(points: FloatArray) -> bytes:
    """How bright each point is under a fixed light, a byte each: a scan without light is a silhouette."""
    if len(points) < LIGHT_NEIGHBOURS:
        return b"\xff" * len(points)
    open3d = load_open3d()
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points - points.mean(axis=0)))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(LIGHT_NEIGHBOURS), fast_normal_computation=True)
    # From both sides alike: the normals have no sign.
    normals = np.abs(np.asarray(cloud.normals) @ LIGHT_DIRECTION)
    return _as_bytes(np.rint(1 + 253 * np.clip(normals, 0.0, 1.0)), "<u1")


def _spread(points: FloatArray, rows: IntArray, most: int) -> IntArray:
    if len(rows) > most:
        # Even steps along a space-filling curve leave no holes.
        ordered = rows[morton_order(points[rows])]
        rows = ordered[np.linspace(0, len(ordered) - 1, most).astype(np.int64)]
    # In random order any first part of them is as even: less is drawn while the view turns.
    mixed: IntArray = np.random.default_rng(0).permutation(rows)
    return mixed


def _quantised(points: FloatArray) -> tuple[dict[str, Any], bytes]:
    """Places in 16-bit steps of their box: what the page must know, and the steps."""
    low = points.min(axis=0) if len(points) else np.zeros(3)
    extent = np.maximum(np.ptp(points, axis=0), 1e-12) if len(points) else np.ones(3)
    known = {"low": low.tolist(), "extent": extent.tolist(), "count": len(points)}
    return known, _as_bytes(np.rint((points - low) / extent * COORDINATE_STEPS), "<u2")


def _padded(data: bytes) -> bytes:
    """Zeros after which numbers of four bytes may follow."""
    return b"\0" * (-len(data) % 4)


def _as_bytes(array: NDArray[Any], kind: str) -> bytes:
    """An array as the page reads it."""
    return np.ascontiguousarray(array, dtype=kind).tobytes()


def part_payload(part: PointCloud | Mesh, frame: DrawnFrame, labels: IntArray | None) -> tuple[dict[str, Any], bytes]:
    """The part to draw: vertices, triangles ordered by face, sharp edges. Shapes: labels (f,), face of each triangle.

    Lighter surfaces follow, the finest first.
    """
    if isinstance(part, PointCloud):
        everything = np.ones(len(part.points), dtype=bool)
        return cloud_payload(part.points, frame, rows_to_draw(part.points, everything))
    assert labels is not None
    vertices, faces = fewer_triangles(frame.to_drawn(part.vertices), part.faces, MAX_TRIANGLES)
    surfaces = [(vertices, faces)]
    for most in MOVING_TRIANGLES:
        if len(surfaces[-1][1]) > 2 * most:
            surfaces.append(fewer_triangles(*surfaces[-1], most))
    about: list[MeshSurface] = []
    words, data = zip(*(_surface(part, frame, labels, *each, about) for each in surfaces), strict=True)
    edges = sharp_edges(vertices, faces)
    whole = words[0] | {"kind": "mesh", "total": len(part.faces), "edges": len(edges), "levels": list(words[1:])}
    return whole, data[0] + _as_bytes(edges, "<f4") + b"".join(data[1:])


def _surface(
    part: Mesh, frame: DrawnFrame, labels: IntArray, vertices: FloatArray, faces: IntArray, about: list[MeshSurface]
) -> tuple[dict[str, Any], bytes]:
    """Vertices, then triangles: those of one face of the part follow each other."""
    own = _labels(part, frame, labels, vertices, faces, about)
    order = np.argsort(own, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(own[order]) != 0])
    ranges = np.column_stack([own[order][starts], starts, np.diff(np.r_[starts, len(order)])])
    known, steps = _quantised(vertices)
    words = {**known, "drawn": len(faces), "faces": ranges.tolist()}
    return words, steps + _padded(steps) + _as_bytes(faces[order], "<u4")


def _labels(
    part: Mesh, frame: DrawnFrame, labels: IntArray, vertices: FloatArray, faces: IntArray, about: list[MeshSurface]
) -> IntArray:
    """Number of the part's face that each drawn triangle lies on; the surface that is asked is made once, if at all."""
    if len(faces) == len(part.faces) or not labels.any():
        return labels[: len(faces)]
    if not about:
        about.append(MeshSurface(Mesh(part.vertices - frame.middle, part.faces)))
    return labels[about[0].closest(frame.to_side(vertices[faces].mean(axis=1)) - frame.middle).elements]
