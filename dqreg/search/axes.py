"""Initial poses from moments: centre on centre and principal axes on principal axes, in all 24 ways.

They need a scan of most of the part; for a scan of one side, or of a scene, there is `dqreg.search.pairs`.
"""

from __future__ import annotations

import functools
import itertools

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Mesh, PointCloud, Scan
from dqreg.search.poses import Poses

# Normals that are equal in so many parts of one are of one face.
NORMAL_BINS_PER_UNIT = 200
# Faces that are looked at, the largest first.
MAX_FACES = 30
# Cosine below which two are perpendicular.
PERPENDICULAR_COS = 0.02


def axis_hypotheses(scan: Scan | PointCloud | Mesh, target: PointCloud | Mesh) -> Poses:
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


def half_sphere(count: int) -> FloatArray:
    """Unit directions evenly over half a sphere, by the golden angle, (n, 3)."""
    rows = np.arange(count) + 0.5
    heights, angles = rows / count, np.pi * (1.0 + np.sqrt(5.0)) * rows
    radii = np.sqrt(1.0 - heights**2)
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles), heights])


def principal_axes(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and right-handed principal axes, one a column, of a distribution. Shapes: covariance (3, 3), axes (3, 3)."""
    _, axes = np.linalg.eigh(covariance)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return mean, axes


def face_axes(mesh: Mesh) -> FloatArray | None:
    """Right-handed axes along the normals of the largest faces, one a column; None where no two are perpendicular.

    The moments of a body that is nearly a cube tell its axes from nothing but details.
    """
    directions = _largest_directions(mesh)
    found = directions / np.linalg.norm(directions, axis=1, keepdims=True).clip(min=0.5)
    across = np.flatnonzero(np.abs(found @ found[0]) < PERPENDICULAR_COS) if len(found) else found
    if not len(across):
        return None
    return np.ascontiguousarray(axes_of_normals(found[0], found[across[0]]).T)


def axes_of_normals(one: FloatArray, other: FloatArray) -> FloatArray:
    """Right-handed axes, one a row: along a unit normal, along what of another lies across it, and across both."""
    second = other - (one @ other) * one
    second /= np.linalg.norm(second)
    return np.stack([one, second, np.cross(one, second)])


def _largest_directions(mesh: Mesh) -> IntArray:
    """Normals in so many parts of one of the most area, (k, 3), the largest first."""
    from dqreg.kernels.meshes.areas_by_direction import areas_by_direction
    from dqreg.kernels.threads import as_plain

    count, base = 1 << len(mesh.faces).bit_length(), 2 * NORMAL_BINS_PER_UNIT + 1
    codes, sums = np.zeros(count, dtype=np.int64), np.zeros(count)
    areas_by_direction(as_plain(mesh.face_normals), as_plain(mesh.face_areas), NORMAL_BINS_PER_UNIT, codes, sums)
    rows = np.flatnonzero(codes)
    if len(rows) > MAX_FACES:
        rows = rows[sums[rows] >= np.partition(sums[rows], -MAX_FACES)[-MAX_FACES]]
    rows = rows[np.lexsort((codes[rows], -sums[rows]))][:MAX_FACES]
    digits: IntArray = (codes[rows] - 1)[:, None] // np.array([base**2, base, 1]) % base - NORMAL_BINS_PER_UNIT
    return digits


def moments(shape: Scan | PointCloud | Mesh) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of a shape: exact for the surface of a mesh, of the points of a cloud.

    Shapes: covariance (3, 3).
    """
    if isinstance(shape, Mesh):
        return shape._moments
    return shape.points.mean(axis=0), np.cov(shape.points.T)
