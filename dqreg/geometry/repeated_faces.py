"""Faces of a mesh that are there more than once, as exports have them: the same three vertices, in either sense.

One more face at an edge opens a mesh that is closed. But two bodies that touch have a face each there, in opposite
senses, and are closed with both: repeats are left out where fewer edges are faulty without them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.topology import SameNodes


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
