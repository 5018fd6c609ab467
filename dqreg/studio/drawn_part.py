"""The part as the page draws it: triangles by face, sharp edges, and lighter surfaces for a view that moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Mesh, MeshSurface, PointCloud
from dqreg.report.view3d import fewer_triangles, sharp_edges
from dqreg.studio.drawing import Frame, as_bytes, cloud_payload, padded, quantised, rows_to_draw

# What is drawn at most.
TRIANGLES = 120_000
# Triangles of the surfaces that stand for the part while the view moves, each where there are more than twice as many.
MOVING = (12_000, 3_000)


def part_payload(part: PointCloud | Mesh, frame: Frame, labels: IntArray | None) -> tuple[dict[str, Any], bytes]:
    """The part to draw: vertices, triangles ordered by face, sharp edges. Shapes: labels (f,), face of each triangle.

    Lighter surfaces follow, the finest first.
    """
    if isinstance(part, PointCloud):
        everything = np.ones(len(part.points), dtype=bool)
        return cloud_payload(part.points, frame, rows_to_draw(part.points, everything))
    assert labels is not None
    vertices, faces = fewer_triangles(frame.to_drawn(part.vertices), part.faces, TRIANGLES)
    surfaces = [(vertices, faces)]
    for most in MOVING:
        if len(surfaces[-1][1]) > 2 * most:
            surfaces.append(fewer_triangles(*surfaces[-1], most))
    about: list[MeshSurface] = []
    words, data = zip(*(_surface(part, frame, labels, *each, about) for each in surfaces), strict=True)
    edges = sharp_edges(vertices, faces)
    whole = words[0] | {"kind": "mesh", "total": len(part.faces), "edges": len(edges), "levels": list(words[1:])}
    return whole, data[0] + as_bytes(edges, "<f4") + b"".join(data[1:])


def _surface(
    part: Mesh, frame: Frame, labels: IntArray, vertices: FloatArray, faces: IntArray, about: list[MeshSurface]
) -> tuple[dict[str, Any], bytes]:
    """Vertices, then triangles: those of one face of the part follow each other."""
    own = _labels(part, frame, labels, vertices, faces, about)
    order = np.argsort(own, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(own[order]) != 0])
    ranges = np.column_stack([own[order][starts], starts, np.diff(np.r_[starts, len(order)])])
    known, steps = quantised(vertices)
    words = {**known, "drawn": len(faces), "faces": ranges.tolist()}
    return words, steps + padded(steps) + as_bytes(faces[order], "<u4")


def _labels(
    part: Mesh, frame: Frame, labels: IntArray, vertices: FloatArray, faces: IntArray, about: list[MeshSurface]
) -> IntArray:
    """Number of the part's face that each drawn triangle lies on; the surface that is asked is made once, if at all."""
    if len(faces) == len(part.faces) or not labels.any():
        return labels[: len(faces)]
    if not about:
        about.append(MeshSurface(Mesh(part.vertices - frame.middle, part.faces)))
    return labels[about[0].closest(frame.to_side(vertices[faces].mean(axis=1)) - frame.middle).elements]
