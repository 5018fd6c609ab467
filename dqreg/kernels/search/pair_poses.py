"""Poses of pairs of oriented points on their counterparts, for both signs of directions that stand across the line."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels


@inside_kernels
def unit_line(points: FloatArray, i: int, j: int, frame: FloatArray) -> None:
    """Write the unit vector from point i to point j into the first row."""
    x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    length = np.sqrt(x * x + y * y + z * z)
    frame[0, 0], frame[0, 1], frame[0, 2] = x / length, y / length, z / length


@inside_kernels
def along_line(directions: FloatArray, i: int, frame: FloatArray) -> float:
    """Cosine between direction i and the line in the first row."""
    cosine: float = directions[i, 0] * frame[0, 0] + directions[i, 1] * frame[0, 1] + directions[i, 2] * frame[0, 2]
    return cosine


@inside_kernels
def complete(directions: FloatArray, i: int, sign: float, frame: FloatArray) -> None:
    """Write the part of a signed direction that is across the line, made a unit, and what is across both."""
    cosine, square = sign * along_line(directions, i, frame), 0.0
    for k in range(3):
        frame[1, k] = sign * directions[i, k] - cosine * frame[0, k]
        square += frame[1, k] * frame[1, k]
    length = max(np.sqrt(square), 1e-300)
    for k in range(3):
        frame[1, k] /= length
    a, b, c, p, q, s = frame[0, 0], frame[0, 1], frame[0, 2], frame[1, 0], frame[1, 1], frame[1, 2]
    frame[2, 0], frame[2, 1], frame[2, 2] = b * s - c * q, c * p - a * s, a * q - b * p


@inside_kernels
def turned_cosine(R: FloatArray, ours: FloatArray, i: int, theirs: FloatArray, j: int) -> float:
    """Cosine between our direction i, turned, and their direction j; its sign is as uncertain as theirs."""
    total = 0.0
    for k in range(3):
        turned = R[k, 0] * ours[i, 0] + R[k, 1] * ours[i, 1] + R[k, 2] * ours[i, 2]
        total += turned * theirs[j, k]
    return abs(total)


@compiled
def pair_poses(
    first: int,
    last: int,
    points: FloatArray,
    directions: FloatArray,
    i: IntArray,
    j: IntArray,
    known_points: FloatArray,
    known_directions: FloatArray,
    a: IntArray,
    b: IntArray,
    least_cosine: float,
    least_agreement: float,
    rotations: FloatArray,
    shifts: FloatArray,
    agree: BoolArray,
) -> None:
    """Write the pose that puts pair (i, j) on the known pair (a, b), for matches first to last, and whether it agrees.

    Middle goes on middle and line on line; the direction that stands farther off the line, turned along it, fixes the
    rotation about it. Where its cosine is below ``least_cosine`` the opposite sign is as likely: that is the second
    pose. One agrees if it turns both directions within the angle of the other cosine onto the known ones, signs aside.

    Shapes: i, j, a, b (n,); rotations (2, n, 3, 3), shifts (2, n, 3), agree (2, n). O(1) a match.
    """
    frame, other = np.zeros((3, 3)), np.zeros((3, 3))
    for m in range(first, last):
        unit_line(points, i[m], j[m], frame)
        unit_line(known_points, a[m], b[m], other)
        cosines = along_line(directions, i[m], frame), along_line(directions, j[m], frame)
        is_first = abs(cosines[0]) <= abs(cosines[1])
        ours, theirs = (i[m], a[m]) if is_first else (j[m], b[m])
        cosine = cosines[0] if is_first else cosines[1]
        complete(directions, ours, -1.0 if cosine < 0.0 else 1.0, frame)
        sign = -1.0 if along_line(known_directions, theirs, other) < 0.0 else 1.0
        for way in range(2):
            if way == 1 and not abs(cosine) < least_cosine:
                continue
            complete(known_directions, theirs, sign if way == 0 else -sign, other)
            R = rotations[way, m]
            for k in range(3):
                for n in range(3):
                    R[k, n] = other[0, k] * frame[0, n] + other[1, k] * frame[1, n] + other[2, k] * frame[2, n]
            agree[way, m] = (
                turned_cosine(R, directions, i[m], known_directions, a[m]) > least_agreement
                and turned_cosine(R, directions, j[m], known_directions, b[m]) > least_agreement
            )
            for k in range(3):
                middle = 0.5 * (known_points[a[m], k] + known_points[b[m], k])
                for n in range(3):
                    middle -= R[k, n] * 0.5 * (points[i[m], n] + points[j[m], n])
                shifts[way, m, k] = middle
