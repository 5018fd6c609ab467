"""Patches between two lines: open ladders, collars around a hole, lofts through sections."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.synth.parts.patches import fan


def ladder(left: FloatArray, right: FloatArray) -> FloatArray:
    """Strip between two lines with the same number of corners.

    Shapes: left, right (k, 2), returns (2 k - 2, 3, 2).

    >>> ladder(np.array([[0.0, 1.0], [1.0, 1.0]]), np.array([[0.0, 0.0], [1.0, 0.0]])).shape
    (2, 3, 2)
    """
    a, b, c, d = left[:-1], right[:-1], right[1:], left[1:]
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def collar(outer: FloatArray, hole: FloatArray) -> FloatArray:
    """Flat band between a closed outline and a convex hole with any number of corners each.

    Shapes: outer (k, 2), hole (m, 2), returns (k + m, 3, 2).

    Both loops are walked side by side, in the order of the angle at the middle of the hole, and each step adds the
    triangle between the corner left, the corner reached and the corner waiting on the other side.

    >>> square = np.array([[2.0, -2], [2, 2], [-2, 2], [-2, -2]])
    >>> len(collar(square, 0.5 * square))
    8
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
    """Side faces through closed sections that lie one above the other.

    Shapes: sections (m, k, 3).

    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> loft(np.stack([square, square + [0.0, 0.0, 2.0]])).shape
    (8, 3, 3)
    """
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
