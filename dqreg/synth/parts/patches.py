"""Flat and curved patches of triangles, and the weld that makes one mesh of them.

A patch in the plane is an array (n, 3, 2) of triangles, counter-clockwise; in space it is (n, 3, 3), and the
normal by the right-hand rule looks out of the material. Patches that meet must share their vertices bit for
bit.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg._numbers import is_whole
from dqreg.errors import InputError

# More facets than this in one circle are a typing error, not a part.
MAX_FACETS = 2_000


def require_count(
    name: str, value: Any, least: int, *, most: int = MAX_FACETS, multiple: int = 1, index: int | None = None
) -> None:
    """Raise unless a count is a whole number within reason."""
    whole = is_whole(value)
    if not whole or not least <= value <= most or value % multiple:
        of = f", a multiple of {multiple}" if multiple > 1 else ""
        raise InputError.of(f"must be a whole number from {least} to {most}{of}", name=name, index=index, given=value)


def require_order(**lengths: float) -> None:
    """Raise unless each length is smaller than the next."""
    names = list(lengths)
    for small, large in itertools.pairwise(names):
        if not lengths[small] < lengths[large]:
            raise InputError.of(f"({lengths[small]:g}) must be smaller than {large} ({lengths[large]:g})", name=small)


def circle(centre: Sequence[float], diameter: float, segments: int) -> FloatArray:
    """Regular polygon inscribed in a circle. Shapes: returns (segments, 2)."""
    require_count("segments", segments, 8, multiple=4)
    angle = np.arange(segments) * (2.0 * np.pi / segments)
    return np.asarray(centre, dtype=np.float64) + 0.5 * diameter * np.column_stack([np.cos(angle), np.sin(angle)])


def grid(u: Sequence[float] | FloatArray, v: Sequence[float] | FloatArray) -> FloatArray:
    """Rectangle cut into cells along given lines, two triangles a cell."""
    U, V = np.meshgrid(u, v, indexing="ij")
    P = np.stack([U, V], axis=-1)
    a, b, c, d = P[:-1, :-1], P[1:, :-1], P[1:, 1:], P[:-1, 1:]
    return np.stack([a, b, c, a, c, d], axis=-2).reshape(-1, 3, 2)


def fan(polygon: Sequence[Sequence[float]] | FloatArray) -> FloatArray:
    """Triangles from the first corner of a polygon to all its other edges.

    Shapes: polygon (k, 2), returns (k - 2, 3, 2).
    """
    P = np.asarray(polygon, dtype=np.float64)
    return np.stack([np.broadcast_to(P[0], P[2:].shape), P[1:-1], P[2:]], axis=1)


def ring(u: tuple[float, float], v: tuple[float, float], hole: FloatArray) -> FloatArray:
    """Rectangle with one round hole, without a vertex on its sides other than the four corners.

    Shapes: hole (k, 2), returns (k + 4, 3, 2).

    Each quarter of the hole is joined to the corner that lies the same way, and each side of the rectangle to the
    vertex of the hole that is nearest to it. Both always see each other, wherever the hole lies.
    """
    low, high = hole.min(axis=0), hole.max(axis=0)
    if low[0] <= u[0] or high[0] >= u[1] or low[1] <= v[0] or high[1] >= v[1]:
        raise InputError(
            f"a round of diameter {high[0] - low[0]:g} about ({hole[:, 0].mean():g}, {hole[:, 1].mean():g}) "
            f"does not fit into its face, {u[0]:g} to {u[1]:g} by {v[0]:g} to {v[1]:g}; make it smaller"
        )
    quarter = len(hole) // 4
    corners = np.array([[u[1], v[1]], [u[0], v[1]], [u[0], v[0]], [u[1], v[0]]])
    rounds = np.stack([hole, np.repeat(corners, quarter, axis=0), np.roll(hole, -1, axis=0)], axis=1)
    sides = np.stack([corners, np.roll(corners, -1, axis=0), np.roll(hole[::quarter], -1, axis=0)], axis=1)
    return np.concatenate([rounds, sides])


def annulus(outer: FloatArray, inner: FloatArray) -> FloatArray:
    """Flat band between two polygons with the same number of corners.

    Shapes: outer, inner (k, 2), returns (2 k, 3, 2).
    """
    a, b, c, d = inner, outer, np.roll(outer, -1, axis=0), np.roll(inner, -1, axis=0)
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def lift(triangles: FloatArray, axis: int, height: float, *, outward: int = 1) -> FloatArray:
    """Put plane triangles into space, across one coordinate axis. Shapes: triangles (n, 3, 2), returns (n, 3, 3)."""
    space = np.full((*triangles.shape[:2], 3), float(height))
    space[..., (axis + 1) % 3] = triangles[..., 0]
    space[..., (axis + 2) % 3] = triangles[..., 1]
    return space if outward > 0 else space[:, ::-1]


def walls(
    outline: FloatArray, axis: int, span: tuple[float, float], *, outward: int = 1, closed: bool = True
) -> FloatArray:
    """Side faces of the prism over an outline. Shapes: outline (k, 2), returns (2 k or 2 k - 2, 3, 3)."""
    count = len(outline) if closed else len(outline) - 1
    corners = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)[:count]
    low, high = (lift(corners, axis, height) for height in span)
    a, b, c, d = low[:, 0], low[:, 1], high[:, 1], high[:, 0]
    space = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return space if outward > 0 else space[:, ::-1]


def weld(patches: Iterable[FloatArray]) -> tuple[FloatArray, IntArray]:
    """One indexed mesh of many patches; vertices that are equal bit for bit become one. Shapes: patches (n, 3, 3)."""
    soup = np.concatenate(list(patches)).reshape(-1, 3) + 0.0  # + 0.0 turns -0.0 into 0.0
    vertices, inverse = np.unique(soup, axis=0, return_inverse=True)
    return vertices, inverse.reshape(-1, 3).astype(np.int64)


def ladder(left: FloatArray, right: FloatArray) -> FloatArray:
    """Strip between two lines with the same number of corners. Shapes: left, right (k, 2), returns (2 k - 2, 3, 2)."""
    a, b, c, d = left[:-1], right[:-1], right[1:], left[1:]
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def collar(outer: FloatArray, hole: FloatArray) -> FloatArray:
    """Flat band between a closed outline and a convex hole with any number of corners each.

    Shapes: outer (k, 2), hole (m, 2), returns (k + m, 3, 2).

    Both loops are walked side by side, in the order of the angle at the middle of the hole, and each step adds the
    triangle between the corner left, the corner reached and the corner waiting on the other side.
    """
    middle = hole.mean(axis=0)
    P, outer_rad = _by_angle(outer, middle)
    Q, inner_rad = _by_angle(hole, middle)
    is_inner = np.repeat([False, True], [len(P), len(Q)])
    # Every corner but the first of its loop is one step; the step back to the first comes a full turn later.
    reached = np.concatenate([outer_rad[1:], outer_rad[:1] + 2 * np.pi, inner_rad[1:], inner_rad[:1] + 2 * np.pi])
    is_inner = is_inner[np.argsort(reached, kind="stable")]
    i, j = np.cumsum(~is_inner), np.cumsum(is_inner)  # where each loop stands after the step
    o_now, h_now = P[i % len(P)], Q[j % len(Q)]
    o_before, h_before = P[(i - 1) % len(P)], Q[(j - 1) % len(Q)]
    along_outer = np.stack([o_before, o_now, h_now], axis=1)
    along_inner = np.stack([h_before, o_now, h_now], axis=1)
    return np.where(is_inner[:, None, None], along_inner, along_outer)


def loft(sections: FloatArray) -> FloatArray:
    """Side faces through closed sections that lie one above the other. Shapes: sections (m, k, 3)."""
    following = np.roll(sections, -1, axis=1)
    a, b = sections[:-1].reshape(-1, 3), following[:-1].reshape(-1, 3)
    c, d = following[1:].reshape(-1, 3), sections[1:].reshape(-1, 3)
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def cap(closing: FloatArray, left: FloatArray, right: FloatArray) -> FloatArray:
    """Flat cap of a section that closes in one corner and ends in an edge.

    Shapes: closing (2,), left, right (k, 2), returns (2 k - 1, 3, 2).
    """
    return np.concatenate([fan(np.stack([closing, right[0], left[0]])), ladder(left, right)])


def _by_angle(corners: FloatArray, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Corners from the one with the least angle at the middle on, bit for bit, and their angles in (-pi, pi]."""
    angle = np.arctan2(corners[:, 1] - middle[1], corners[:, 0] - middle[0])
    first = int(np.argmin(angle))
    return np.roll(corners, -first, axis=0), np.roll(angle, -first)
