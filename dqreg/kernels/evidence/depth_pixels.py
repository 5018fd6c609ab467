"""Pixels of a depth image: directions of points about a viewpoint, the nearest range in each, and what is before it."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# What is divided by instead of zero.
TINY = float(np.finfo(float).tiny)


@inside_kernels
def _direction(points: FloatArray, i: int, axes: FloatArray, eye: FloatArray) -> tuple[float, float, float]:
    """Azimuth, elevation and range of a point; the rows of the axes are right, up, and the line of sight."""
    u, v, w = points[i, 0] - eye[0], points[i, 1] - eye[1], points[i, 2] - eye[2]
    x = axes[0, 0] * u + axes[0, 1] * v + axes[0, 2] * w
    y = axes[1, 0] * u + axes[1, 1] * v + axes[1, 2] * w
    z = axes[2, 0] * u + axes[2, 1] * v + axes[2, 2] * w
    length = math.sqrt(x * x + y * y + z * z)
    return math.atan2(x, z), math.asin(min(max(y / max(length, TINY), -1.0), 1.0)), length


@compiled
def directions_from(
    first: int, last: int, points: FloatArray, axes: FloatArray, eye: FloatArray, places: FloatArray, ranges: FloatArray
) -> None:
    """Write azimuths and elevations, (2, n), and ranges, (n,), of points first to last."""
    for i in range(first, last):
        places[0, i], places[1, i], ranges[i] = _direction(points, i, axes, eye)


@compiled
def fill_nearest(
    places: FloatArray, ranges: FloatArray, low: FloatArray, pixel: float, image: FloatArray, at: IntArray
) -> None:
    """Lower each pixel of an image, (h, w), to the least range in it; and write in which one of all each point is."""
    width = image.shape[1]
    for i in range(len(ranges)):
        row, column = int((places[0, i] - low[0]) / pixel), int((places[1, i] - low[1]) / pixel)
        at[i] = row * width + column
        image[row, column] = min(image[row, column], ranges[i])


@compiled
def count_behind(ranges: FloatArray, image: FloatArray, at: IntArray, times: float) -> int:
    """How many points are farther off than so many times the least range in their pixels."""
    width, count = image.shape[1], 0
    for i in range(len(ranges)):
        if ranges[i] > times * image[at[i] // width, at[i] % width]:
            count += 1
    return count


@compiled
def least_around(image: FloatArray, found: FloatArray) -> None:
    """Write the least of each pixel and those around it. O(h w)."""
    height, width = image.shape
    along = np.zeros((height, width))
    for row in range(height):
        for column in range(width):
            along[row, column] = image[row, column]
        for column in range(width - 1):
            along[row, column] = min(along[row, column], image[row, column + 1])
        for column in range(1, width):
            along[row, column] = min(along[row, column], image[row, column - 1])
    for row in range(height):
        above, below = max(row - 1, 0), min(row + 1, height - 1)
        for column in range(width):
            found[row, column] = min(along[row, column], along[above, column], along[below, column])


@compiled
def count_before(
    points: FloatArray,
    axes: FloatArray,
    eye: FloatArray,
    low: FloatArray,
    pixel: float,
    nearest: FloatArray,
    filled: BoolArray,
    margin: float,
    step: float,
    counts: IntArray,
) -> None:
    """Count points that are nearer than what was seen there by a margin and so many pixels, and those as far."""
    height, width = filled.shape
    for i in range(len(points)):
        azimuth, elevation, length = _direction(points, i, axes, eye)
        row, column = math.floor((azimuth - low[0]) / pixel), math.floor((elevation - low[1]) / pixel)
        if not (0 <= row < height and 0 <= column < width) or not filled[row, column]:
            continue
        nearer, limit = nearest[row, column] - length, margin + step * pixel * length
        counts[0] += 1 if nearer > limit else 0
        counts[1] += 1 if abs(nearer) <= limit else 0
