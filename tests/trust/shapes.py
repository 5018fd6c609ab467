"""Points of plain shapes with their exact normals: what a perfect registration to them would be judged by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg.trust import Information, information_of

FloatArray = NDArray[np.float64]


def unit(vector: FloatArray) -> FloatArray:
    """Rows brought to length one."""
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def plane(rng: np.random.Generator, n: int = 400) -> tuple[FloatArray, FloatArray]:
    """Square of side 2 in z = 0."""
    return np.column_stack([rng.uniform(-1, 1, (n, 2)), np.zeros(n)]), np.tile([0.0, 0, 1], (n, 1))


def sphere(rng: np.random.Generator, n: int = 400) -> tuple[FloatArray, FloatArray]:
    """Unit sphere about the origin."""
    normals = unit(rng.normal(size=(n, 3)))
    return normals, normals


def cylinder(rng: np.random.Generator, n: int = 400) -> tuple[FloatArray, FloatArray]:
    """Side of a cylinder of radius 1 and height 2 along z."""
    angle = rng.uniform(0, 2 * np.pi, n)
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    return normals + np.outer(rng.uniform(-1, 1, n), [0.0, 0, 1]), normals


def box(rng: np.random.Generator, n: int = 400) -> tuple[FloatArray, FloatArray]:
    """Cuboid of 3 x 2 x 1 about the origin."""
    half = np.array([1.5, 1.0, 0.5])
    axis, sign = rng.integers(3, size=n), rng.choice([-1.0, 1.0], size=n)
    normals = np.eye(3)[axis] * sign[:, None]
    return np.where(normals != 0.0, normals, rng.uniform(-1, 1, (n, 3))) * half, normals


def judged(
    points: FloatArray, normals: FloatArray, residuals: FloatArray | float = 0.0, lever: float = 1.5
) -> Information:
    """Information about the origin, all weights one."""
    n = len(points)
    return information_of(points, normals, np.broadcast_to(residuals, n), np.ones(n), lever, np.zeros(3))
