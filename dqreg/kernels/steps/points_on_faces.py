"""Runs of neighbouring points that lie on one face each: which of a run's points do, their mean and their scatter."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels


@compiled
def points_on_faces(
    first: int,
    last: int,
    points: FloatArray,
    length: int,
    corners: FloatArray,
    faces: IntArray,
    normals: FloatArray,
    T: FloatArray,
    inside: float,
    off: float,
    thick: float,
    spread: float,
    on: BoolArray,
    counts: IntArray,
    means: FloatArray,
    within: FloatArray,
) -> None:
    """Write which points of runs first to last lie on their face, (m, k), how many, their means and scatter. O(n).

    A point lies on a face if it is farther than ``inside`` from its sides and no farther than ``off`` from it; a run
    whose points scatter about it by more than ``thick``, and about their mean by more than ``spread``, has none. Points
    come back as given.
    """
    planes = np.zeros((4, 4))
    for r in range(first, last):
        face_planes(corners, faces[r], normals, r, T, planes)
        count, total, squares, x, y, z = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(length):
            i = r * length + j
            h, least = 0.0, np.inf
            for k in range(4):
                above = height(planes, k, points, i)
                if k == 0:
                    h = above
                else:
                    least = min(least, above)
            on[r, j] = least > inside and abs(h) <= off
            if on[r, j]:
                count += 1
                total, squares = total + h, squares + h * h
                x, y, z = x + points[i, 0], y + points[i, 1], z + points[i, 2]
        if count > 0:
            within[r] = squares - total * total / count
        counts[r] = count
        if squares > count * thick * thick and within[r] > count * spread * spread:
            counts[r] = 0
            for j in range(length):
                on[r, j] = False
        if count > 0:
            means[r, 0], means[r, 1], means[r, 2] = x / count, y / count, z / count


@compiled
def height(planes: FloatArray, k: int, points: FloatArray, i: int) -> float:
    """Height of a point above a plane."""
    found: float = (
        planes[k, 0] * points[i, 0] + planes[k, 1] * points[i, 1] + planes[k, 2] * points[i, 2] + planes[k, 3]
    )
    return found


@inside_kernels
def face_planes(corners: FloatArray, face: int, normals: FloatArray, r: int, T: FloatArray, planes: FloatArray) -> None:
    """Write the plane of a face and those square to it through its sides, by their height over untouched points.

    Those of the sides face inwards.
    """
    for k in range(4):
        x, y, z = normals[r, 0], normals[r, 1], normals[r, 2]
        start, end = max(k - 1, 0), k % 3
        if k > 0:
            dx, dy = corners[face, end, 0] - corners[face, start, 0], corners[face, end, 1] - corners[face, start, 1]
            dz = corners[face, end, 2] - corners[face, start, 2]
            x, y, z = y * dz - z * dy, z * dx - x * dz, x * dy - y * dx
            size = np.sqrt(x * x + y * y + z * z)
            x, y, z = x / size, y / size, z / size
        for a in range(3):
            planes[k, a] = x * T[0, a] + y * T[1, a] + z * T[2, a]
        planes[k, 3] = (
            x * (T[0, 3] - corners[face, start, 0])
            + y * (T[1, 3] - corners[face, start, 1])
            + z * (T[2, 3] - corners[face, start, 2])
        )
