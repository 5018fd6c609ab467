"""Initial poses from moments: centre on centre and principal axes on principal axes, in all 24 ways.

They need a scan of most of the part; for a scan of one side, or of a scene, there is `dqreg.search.pairs`.
"""

from __future__ import annotations

import functools
import itertools

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Mesh, PointCloud, Scan
from dqreg.geometry.morton import sorted_rows
from dqreg.search.poses import Poses

# Normals that are equal in so many parts of one are of one face; faces that are looked at, the largest first; cosine
# below which two are perpendicular.
ALIKE, LARGEST, ACROSS = 200, 30, 0.02


def axis_hypotheses(scan: Scan, target: PointCloud | Mesh) -> Poses:
    """Initial poses that put centre on centre and principal axes on principal axes."""
    source_mean, source_axes = principal_axes(*moments(scan))
    target_mean, target_axes = principal_axes(*moments(target))
    R = [target_axes @ turn @ source_axes.T for turn in cube_rotations()]
    return Poses(np.array(R), np.array([target_mean - each @ source_mean for each in R]))


@functools.cache
def cube_rotations() -> tuple[FloatArray, ...]:
    """The 24 rotations that map the coordinate axes onto each other, (3, 3) each."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.eye(3)[list(order)] * np.array(signs)
            if np.linalg.det(R) > 0.0:
                R.flags.writeable = False
                found.append(R)
    return tuple(found)


def principal_axes(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and right-handed principal axes, one a column, of a distribution. Shapes: covariance (3, 3), axes (3, 3)."""
    _, axes = np.linalg.eigh(covariance)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return mean, axes


def face_axes(mesh: Mesh) -> FloatArray | None:
    """Right-handed axes along the normals of the largest faces, one a column; None where no two are perpendicular.

    The moments of a body that is nearly a cube tell its axes from nothing but details.
    """
    normals, areas = mesh.face_normals, mesh.face_areas
    directions = (normals * ALIKE).round().astype(np.int64)
    # One number for each: digits to the base of all values that a component may have.
    rows = _numbered((directions + ALIKE) @ np.array([(2 * ALIKE + 1) ** 2, 2 * ALIKE + 1, 1]))
    order = np.argsort(-np.bincount(rows, areas), kind="stable")[:LARGEST]
    firsts = np.zeros(int(rows.max()) + 1, dtype=np.int64)
    firsts[rows] = np.arange(len(rows))
    directions = directions[firsts[order]]
    found = directions / np.linalg.norm(directions, axis=1, keepdims=True).clip(min=0.5)
    across = np.flatnonzero(np.abs(found @ found[0]) < ACROSS) if len(found) else found
    if not len(across):
        return None
    first = found[0]
    second = found[across[0]] - (found[across[0]] @ first) * first
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=1)


def _numbered(codes: IntArray) -> IntArray:
    """Place of each of some numbers from 0 on among the different ones, ascending, (n,)."""
    order = sorted_rows(codes.astype(np.uint64))
    walked = codes[order]
    numbers = np.zeros(len(codes), dtype=np.int64)
    numbers[order[1:]] = np.cumsum(walked[1:] != walked[:-1])
    return numbers


def moments(shape: Scan | PointCloud | Mesh) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of a shape: exact for the surface of a mesh, of the points of a cloud.

    Shapes: covariance (3, 3).
    """
    if isinstance(shape, Mesh):
        return shape._moments
    return shape.points.mean(axis=0), np.cov(shape.points.T)
