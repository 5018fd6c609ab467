"""Runs of neighbouring points that lie on one face each: which of a run's points do, their mean and their scatter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

Plane = tuple[float, float, float, float]


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
    parts: NDArray[np.uint8],
    on: BoolArray,
    counts: IntArray,
    means: FloatArray,
    within: FloatArray,
) -> None:
    """Write which points of runs first to last lie on their face, (m, k), how many, their means and scatter. O(n).

    These are of each part of the scan, (m, p), given the part of each point, (n,). A point lies on a face if it is
    farther than ``inside`` from its sides and no farther than ``off`` from it; a run whose points scatter about it by
    more than ``thick``, and about their mean by more than ``spread``, has none. Points come back as given.
    """
    planes, totals = np.zeros((4, 4)), np.zeros(counts.shape[1])
    for r in range(first, last):
        face_planes(corners, faces[r], normals, r, T, planes)
        totals[:] = 0.0
        count, total, squares = 0, 0.0, 0.0
        # Numbers of their own: those of an array would be read anew for every point, as others are written to.
        face, one, two, three = plane(planes[0]), plane(planes[1]), plane(planes[2]), plane(planes[3])
        for j in range(np.uint64(length)):
            i = np.uint64(r * length) + j
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            h, inset = height(face, x, y, z), min(height(one, x, y, z), height(two, x, y, z), height(three, x, y, z))
            on[r, j] = inset > inside and abs(h) <= off
            if on[r, j]:
                part = parts[i]
                count, counts[r, part] = count + 1, counts[r, part] + 1
                total, totals[part] = total + h, totals[part] + h
                squares, within[r, part] = squares + h * h, within[r, part] + h * h
                means[r, part, 0] += x
                means[r, part, 1] += y
                means[r, part, 2] += z
        if squares > count * thick * thick and squares - total * total / count > count * spread * spread:
            counts[r] = 0
            on[r] = False
        for part in range(counts.shape[1]):
            if counts[r, part] > 0:
                within[r, part] -= totals[part] * totals[part] / counts[r, part]
                means[r, part] /= counts[r, part]


@inside_kernels
def plane(numbers: FloatArray) -> Plane:
    """The four numbers of a plane, (4,)."""
    return numbers[0], numbers[1], numbers[2], numbers[3]


@inside_kernels
def height(plane: Plane, x: float, y: float, z: float) -> float:
    """Height of a point above a plane."""
    return plane[0] * x + plane[1] * y + plane[2] * z + plane[3]


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
