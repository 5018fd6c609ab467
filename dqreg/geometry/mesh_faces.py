"""The faces of a part: its mesh cut where it turns sharply or a large plane ends."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg._records import made_once
from dqreg.geometry.face_profiles import connected, cut_walls, pieces_of
from dqreg.geometry.mesh import Mesh

# Neighbouring triangles that turn by more than this are two faces of the part.
SHARP_DEG = 22.0
# Triangles within this of a plane that make up that share of the part's area are a flat face.
LEVEL_DEG, FLAT_AREA = 0.5, 0.02
# Triangles of a face that may be cut where its curvature changes.
MIN_CUT_TRIANGLES = 6


def faces_of(mesh: Mesh) -> tuple[int, IntArray]:
    """Faces of a part: as its file tells them, else triangles connected without a sharp turn. Shapes: labels (f,).

    Found once a mesh, which keeps them: an inspection asks some ten times.
    """
    return made_once(mesh, "_part_faces", lambda: _found(mesh))


def _found(mesh: Mesh) -> tuple[int, IntArray]:
    count, labels = _cut_faces(mesh)
    labels.setflags(write=False)
    return count, labels


def _cut_faces(mesh: Mesh) -> tuple[int, IntArray]:
    if mesh.regions is not None:
        # Numbers without gaps: a face of the file may have lost all its triangles.
        numbers, labels = np.unique(mesh.regions, return_inverse=True)
        return len(numbers), labels.astype(np.int64)
    ends, owners = weld_edges(mesh.vertices, mesh.faces)
    # Two triangles at an edge are neighbours; at an edge with one, three or more, the surface ends or branches.
    starts = np.flatnonzero(np.r_[True, (ends[1:] != ends[:-1]).any(axis=1)])
    pairs = starts[np.diff(np.r_[starts, len(ends)]) == 2]
    links = np.column_stack([owners[pairs], owners[pairs + 1]])
    turn = np.einsum("ij,ij->i", mesh.face_normals[links[:, 0]], mesh.face_normals[links[:, 1]])
    _, planes = connected(links[turn > np.cos(np.deg2rad(LEVEL_DEG))], len(mesh.faces))
    areas = triangle_areas(mesh)
    flat = (np.bincount(planes, weights=areas) > FLAT_AREA * areas.sum())[planes]
    # A fillet runs smoothly into the planes beside it: large planes are faces of their own, whatever they run into.
    apart = flat[links[:, 0]] | flat[links[:, 1]]
    same = planes[links[:, 0]] == planes[links[:, 1]]
    smooth = turn > np.cos(np.deg2rad(SHARP_DEG))
    return _cut(mesh, links[np.where(apart, same, smooth)], areas)


def _cut(mesh: Mesh, links: IntArray, areas: FloatArray) -> tuple[int, IntArray]:
    """Smooth faces cut where their curvature changes: walls from their fillets, and at the ends of arcs."""
    one, two = mesh.corners[links[:, 0]], mesh.corners[links[:, 1]]
    shared = (one[:, :, None] == two[:, None]).all(axis=3).any(axis=2)
    # Both corners that neighbours share, first in the order.
    ends = np.take_along_axis(one, np.argsort(~shared, axis=1, kind="stable")[:, :2, None], axis=1)
    _, labels = connected(links, len(mesh.faces))
    between = cut_walls(links, labels, mesh.face_normals, areas, ends)
    links, ends = links[~between], ends[~between]
    count, labels = connected(links, len(mesh.faces))
    order, of_link = np.argsort(labels, kind="stable"), labels[links[:, 0]] if len(links) else np.zeros(0, np.int64)
    bounds = np.searchsorted(labels[order], np.arange(count + 1))
    sorted_links = np.argsort(of_link, kind="stable")
    link_bounds = np.searchsorted(of_link[sorted_links], np.arange(count + 1))
    level, place = float(np.cos(np.deg2rad(LEVEL_DEG))), np.zeros(len(labels), dtype=np.int64)
    found = labels.copy()
    for k in np.flatnonzero(np.diff(bounds) >= MIN_CUT_TRIANGLES):
        rows, own = order[bounds[k] : bounds[k + 1]], sorted_links[link_bounds[k] : link_bounds[k + 1]]
        place[rows] = np.arange(len(rows))
        pieces = pieces_of(
            place[links[own]], ends[own], mesh.face_normals[rows], areas[rows], mesh.corners[rows], level
        )
        if pieces is not None:
            found[rows] = np.where(pieces == 0, k, found.max() + pieces)
    # In the order of their first triangles, as connected faces are numbered.
    _, first, place = np.unique(found, return_index=True, return_inverse=True)
    return len(first), np.argsort(np.argsort(first))[place].astype(np.int64)


def weld_edges(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, IntArray]:
    """Sides of all triangles, sorted so that equal ones follow each other; equal corners count as one.

    Shapes: ends (3 f, 2), owners (3 f,).
    """
    # Ranks of different vertices, column by column: a third of the time of sorting whole rows.
    order = np.lexsort(vertices.T[::-1])
    ranked = vertices[order]
    welded = np.zeros(len(vertices), dtype=np.int64)
    welded[order] = np.cumsum(np.r_[False, (ranked[1:] != ranked[:-1]).any(axis=1)])
    corners = welded[faces]
    sides = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    owners = np.repeat(np.arange(len(faces)), 3)
    order = np.argsort(sides[:, 0] * len(vertices) + sides[:, 1], kind="stable")
    return sides[order], owners[order]


def areas_of(mesh: Mesh, of_face: IntArray) -> FloatArray:
    """Area of each face of a part. Shapes: of_face (f,)."""
    areas: FloatArray = np.bincount(of_face, weights=triangle_areas(mesh)).astype(np.float64)
    return areas


def triangle_areas(mesh: Mesh) -> FloatArray:
    """Area of each triangle. Shapes: returns (f,)."""
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    areas: FloatArray = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas
