"""Pieces of plane faces in a cloud that several scans share: each grown from the few points nearest to a seed."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.clouds.plane_fits import ELEMENTS, diagonalise
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Points that a plane is begun with, and those that a piece has at least.
FIRST_POINTS, MIN_POINTS = 8, 6
# Fits from the first one to the last.
FITS = 4
# The normal of a point's own scan may be a blend of two faces, but it looks to the same side: least cosine.
SAME_SIDE_COS = 0.3
# Points in a plane spread in both directions by so many times its residuals, at least.
MIN_SPREAD_RESIDUALS = 3.0


@inside_kernels
def grow(
    points: FloatArray,
    normals: FloatArray,
    seed: int,
    neighbours: IntArray,
    scale: float,
    signed: bool,
    members: IntArray,
    frame: FloatArray,
    moments: FloatArray,
    axes: FloatArray,
) -> int:
    """Write the neighbours of a seed on one plane with it; how many, 0 without a plane. O(k).

    Members are within three scales of the plane, whose residuals are 1.5 scales at most. Shapes: points and normals
    (n, 3), neighbours and members (k,); frame (7,) normal, place and residual; moments (6,) and axes (3, 3) are room.
    """
    count = 0
    for fit in range(FITS):
        # Of one type from the first fit on: a literal would be compiled for by itself.
        count = int(np.int64(0))
        for j in range(FIRST_POINTS if fit == 0 else (2 * FIRST_POINTS if fit == 1 else len(neighbours))):
            t = neighbours[j]
            if fit > 0:
                off, cosine = 0.0, 0.0
                for k in range(3):
                    off += (points[t, k] - frame[3 + k]) * frame[k]
                    cosine += normals[t, k] * frame[k]
                if abs(off) > 3.0 * scale or (cosine if signed else abs(cosine)) < SAME_SIDE_COS:
                    continue
            members[count] = t
            count += 1
        if count < MIN_POINTS:
            return 0
        fit_members(points, members, count, frame, moments, axes)
        first = 0
        for k in range(1, 3):
            if moments[k] < moments[first]:
                first = k
        least = max(moments[first], 0.0)
        across = min(moments[(first + 1) % 3], moments[(first + 2) % 3])
        frame[6] = np.sqrt(least / (count - 3))
        if frame[6] > 1.5 * scale or across < MIN_SPREAD_RESIDUALS * MIN_SPREAD_RESIDUALS * least:
            return 0
        facing = 0.0
        for k in range(3):
            facing += normals[seed, k] * axes[k, first]
        for k in range(3):
            frame[k] = -axes[k, first] if signed and facing < 0.0 else axes[k, first]
    return count


@inside_kernels
def fit_members(
    points: FloatArray, members: IntArray, count: int, frame: FloatArray, moments: FloatArray, axes: FloatArray
) -> None:
    """Write the mean of some points, and their moments about it by their axes. O(count)."""
    for k in range(3):
        total = 0.0
        for j in range(count):
            total += points[members[j], k]
        frame[3 + k] = total / count
    for e in range(ELEMENTS):
        moments[e] = 0.0
    for j in range(count):
        t = members[j]
        x, y, z = points[t, 0] - frame[3], points[t, 1] - frame[4], points[t, 2] - frame[5]
        moments[0], moments[1], moments[2] = moments[0] + x * x, moments[1] + y * y, moments[2] + z * z
        moments[3], moments[4], moments[5] = moments[3] + x * y, moments[4] + x * z, moments[5] + y * z
    diagonalise(moments, axes)


@compiled
def measure_pieces(
    first: int,
    last: int,
    points: FloatArray,
    normals: FloatArray,
    seeds: IntArray,
    neighbours: IntArray,
    scale: float,
    signed: bool,
    counts: IntArray,
    residuals: FloatArray,
) -> None:
    """Write how many points the piece of each seed has, 0 without one, and their residual. O(k) each.

    Shapes: seeds, counts and residuals (m,), neighbours (m, k).
    """
    members, frame = np.zeros(neighbours.shape[1], np.int64), np.zeros(7)
    moments, axes = np.zeros(ELEMENTS), np.zeros((3, 3))
    for i in range(first, last):
        counts[i] = grow(points, normals, seeds[i], neighbours[i], scale, signed, members, frame, moments, axes)
        residuals[i] = frame[6]


@compiled
def take_pieces(
    points: FloatArray,
    normals: FloatArray,
    scans: IntArray,
    seeds: IntArray,
    neighbours: IntArray,
    scale: float,
    signed: bool,
    order: IntArray,
    pieces: IntArray,
) -> int:
    """Write the number of the piece that each point belongs to, (n,), -1 without one; how many pieces. O(k) a seed.

    Seeds take their points in the order given, each point once; a piece that one scan alone sees does not count.
    """
    members, frame = np.zeros(neighbours.shape[1], np.int64), np.zeros(7)
    moments, axes = np.zeros(ELEMENTS), np.zeros((3, 3))
    found = 0
    for i in order:
        if pieces[seeds[i]] >= 0:
            continue
        count = grow(points, normals, seeds[i], neighbours[i], scale, signed, members, frame, moments, axes)
        left, several = 0, False
        for j in range(count):
            t = members[j]
            if pieces[t] < 0:
                members[left] = t
                left += 1
                several = several or scans[t] != scans[members[0]]
        if left >= MIN_POINTS and several:
            for j in range(left):
                pieces[members[j]] = found
            found += 1
    return found
