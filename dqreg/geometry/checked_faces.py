"""Faces of a mesh as they are given: checked, told apart by whether they have an area, and rid of repeats.

Exports have faces more than once: the same three vertices, in either sense. One more face at an edge opens a mesh that
is closed. But two bodies that touch have a face each there, in opposite senses, and are closed with both: repeats are
left out where fewer edges are faulty without them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.geometry.topology import SameNodes

# Faces that one thread takes in one go.
CHUNK_FACES = 16_384


def checked_faces(value: Any, vertex_count: int) -> IntArray:
    """Three numbers of vertices a face, (f, 3)."""
    try:
        faces = np.asarray(value)
    except ValueError as error:
        raise InputError("faces must be integers of shape (f, 3); got rows of different lengths") from error
    if faces.size == 0:
        raise InputError("the mesh has no faces; a cloud of points goes in as an (n, 3) array or a PointCloud")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(f"faces must be integers of shape (f, 3); got {faces.dtype} of shape {faces.shape}")
    if faces.min() < 0 or faces.max() >= vertex_count:
        raise InputError(f"faces refer to vertices {faces.min()}..{faces.max()}, but there are {vertex_count}")
    return faces.astype(np.int64)


def checked_regions(value: Any, face_count: int) -> IntArray:
    """Number of the part's face that each triangle is of, (f,)."""
    regions = np.asarray(value)
    if regions.shape != (face_count,) or regions.dtype.kind not in "iu" or (regions < 0).any():
        raise InputError(f"regions must be one number from 0 for each of {face_count} faces; got shape {regions.shape}")
    return regions.astype(np.int64)


def solid_faces(vertices: FloatArray, faces: IntArray) -> tuple[BoolArray, FloatArray]:
    """Which faces have an area, (f,), and the lowest and highest corner of the box around all, (2, 3)."""
    from dqreg.kernels.meshes.mesh_faces import ENDS
    from dqreg.kernels.meshes.mesh_faces import solid_faces as write_solid
    from dqreg.kernels.threads import as_plain, over_chunks

    solid, ends = np.zeros(len(faces), dtype=bool), np.zeros(((len(faces) - 1) // CHUNK_FACES + 1, ENDS))
    # Below float64's own resolution of the face's coordinates, an "area" is rounding.
    given = as_plain(vertices), np.ascontiguousarray(faces), CHUNK_FACES, float(np.finfo(float).eps), solid, ends
    over_chunks(write_solid, len(faces), *given, chunk=CHUNK_FACES)
    if ends[:, 6].any():
        raise InputError("the mesh uses a vertex that is NaN or infinite; repair the mesh first")
    return solid, np.stack([ends[:, :3].min(axis=0), ends[:, 3:6].max(axis=0)])


def repeated_faces(same: SameNodes, faces: IntArray, flat: IntArray) -> BoolArray | None:
    """Which faces to leave out, (f,); None for none, as of all meshes that are closed and wound alike.

    Of a closed surface whose every face is there in both senses it is the second of each.
    """
    from dqreg.kernels.meshes.duplicate_triangles import first_equal
    from dqreg.kernels.threads import aside

    sound = same.soundness(faces, flat)
    if sound.closed and sound.wound and not sound.two_sided:
        return None
    nodes = np.take(same.numbers, faces)
    first: IntArray = aside(first_equal, nodes.sum(axis=1))
    extra = first != np.arange(len(faces))
    if not extra.any():
        return None
    if sound.two_sided:
        alone = same.soundness(faces[~extra], flat)
        return extra if alone.closed and alone.wound else None
    left_out = _mended(extra, first, nodes, np.take(same.numbers, flat))
    return left_out if left_out.any() else None


def _mended(extra: BoolArray, first: IntArray, nodes: NDArray[np.uint64], seams: NDArray[np.uint64]) -> BoolArray:
    """Repeats without which fewer edges are faulty, chosen for all that hang together by edges."""
    from dqreg.kernels.clouds.components import components

    near = np.flatnonzero(np.isin(nodes, nodes[extra]).any(axis=1))
    # Faces without area close seams as others do.
    every = np.concatenate([nodes[near], seams])
    following = np.roll(every, -1, axis=1)
    ahead, (_, edges) = every < following, np.unique(every + following, return_inverse=True)
    edges, count = edges.reshape(every.shape), int(edges.max()) + 1
    rows = np.flatnonzero(np.isin(first[near], first[extra]))
    bodies = components(count + len(rows), np.repeat(count + np.arange(len(rows)), 3), edges[rows].ravel())
    choices = _choices(first[near[rows]], near[rows], _senses(nodes[near[rows]]) == _senses(nodes[first[near[rows]]]))
    # A face two of whose corners are one joins nothing.
    real, costs = (every != following).all(axis=1), np.zeros((len(choices), count + len(rows)))
    for cost, left_out in zip(costs, choices, strict=True):
        kept = real.copy()
        kept[rows] &= ~left_out
        cost[:] = np.bincount(bodies[:count], _faults(edges[kept], ahead[kept], count), len(cost))
    # With as many faults all of them stay.
    found = np.zeros(len(nodes), dtype=bool)
    found[near[rows]] = choices[costs.argmin(axis=0)[bodies[count:]], np.arange(len(rows))]
    return found


def _choices(first: IntArray, rows: IntArray, alike: BoolArray) -> BoolArray:
    """What may be left out of faces that are alike, (4, n), one choice a row.

    None; all but the first in either sense; all but the first; all but the first in the other sense.
    """
    is_first = first == rows
    turned, at = np.unique(first[~alike], return_index=True)
    is_turned = np.isin(rows, rows[~alike][at])
    other = np.where(np.isin(first, turned), is_turned, is_first)
    return ~np.stack([np.ones_like(alike), is_first | is_turned, is_first, other])


def _faults(edges: IntArray, ahead: BoolArray, count: int) -> FloatArray:
    """Two for each edge with an odd number of faces, one where they are even, but not half of them in each sense."""
    uses = np.bincount(edges.ravel(), minlength=count)
    along = np.bincount(edges[ahead], minlength=count)
    return np.where(uses % 2, 2.0, 2 * along != uses)


def _senses(nodes: NDArray[np.uint64]) -> BoolArray:
    """In which of two senses three nodes follow each other, (n,)."""
    a, b, c = nodes.T
    senses: BoolArray = (a < b) ^ (b < c) ^ (c < a)
    return senses
