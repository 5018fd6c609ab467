"""Newton's method on a pose for a quadratic form of its numbers, all six motions free."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import inside_kernels

# Of the six motions, the first: rotations about the origin; translations follow.
TURNS = 3
# Rounds of Jacobi's rotations over all pairs of axes: convergence is quadratic, and ten are more than six axes need.
ROUNDS = 20
# Most damping of a step; curvature counts as this share of the largest strength at least.
MOST, FLATTEST = 1e12, 1e-9


@inside_kernels
def symmetric_axes(a: FloatArray, v: FloatArray) -> None:
    """Turn a symmetric matrix by Jacobi's rotations into its eigenvalues, on the diagonal, and v into their axes.

    Shapes (n, n), one axis a column, unsorted; small eigenvalues of a graded matrix keep their digits. O(n^3).
    """
    n = len(a)
    for p in range(n):
        for q in range(n):
            v[p, q] = 1.0 if p == q else 0.0
    for _ in range(ROUNDS):
        still = True
        for p in range(n - 1):
            for q in range(p + 1, n):
                off = a[p, q]
                # What changes neither of the two is zero.
                if abs(a[p, p]) + abs(off) == abs(a[p, p]) and abs(a[q, q]) + abs(off) == abs(a[q, q]):
                    a[p, q] = a[q, p] = 0.0
                    continue
                still = False
                h = 0.5 * (a[q, q] - a[p, p])
                root = np.sqrt(h * h + off * off)
                t = off / (h + root) if h >= 0.0 else off / (h - root)
                c = 1.0 / np.sqrt(1.0 + t * t)
                s = t * c
                a[p, p], a[q, q] = a[p, p] - t * off, a[q, q] + t * off
                a[p, q] = a[q, p] = 0.0
                for k in range(n):
                    if k not in (p, q):
                        one, two = a[k, p], a[k, q]
                        a[k, p] = a[p, k] = c * one - s * two
                        a[k, q] = a[q, k] = s * one + c * two
                    one, two = v[k, p], v[k, q]
                    v[k, p], v[k, q] = c * one - s * two, s * one + c * two
        if still:
            return


@inside_kernels
def newton_steps(
    M: FloatArray, y: FloatArray, scale: float, steps: int, nothing: float, noise: float, longest: float, flat: float
) -> float:
    """Bring the numbers of a pose, (vec R, t, 1), to the least value of ``y^T M y`` near them; returns that value.

    Damped steps that never raise the value; motions whose squares are below ``flat`` of the largest stay as they are.
    """
    # Lengths that are not constants: loops over those would be unrolled.
    numbers, many = len(y), len(y) // 2
    slope, curvature, strength, step = np.zeros(many), np.zeros(many), np.zeros(many), np.zeros(many)
    H, S, motions, moved = np.zeros((many, many)), np.zeros((many, many)), np.zeros((many, many)), np.zeros(numbers)
    value, damping, before = value_of(M, y), 0.0, np.inf
    scale = max(scale, abs(value))
    for _ in range(steps):
        derive(M, y, slope, H, S)
        count = independent(slope, H, S, flat, curvature, strength, motions)
        if count == 0:
            break
        gain, least, most = 0.0, np.inf, 0.0
        for k in range(count):
            gain += slope[k] * slope[k] / curvature[k]
            least, most = min(least, curvature[k]), max(most, curvature[k])
        last = gain <= nothing * scale
        if last and not gain < 0.25 * before:
            break
        if last:
            damping = 0.0
        while True:
            for i in range(many):
                step[i] = 0.0
                for k in range(count):
                    step[i] -= motions[i, k] * slope[k] / (curvature[k] + damping * strength[k])
            move(y, step, moved)
            reached = value_of(M, moved)
            sound = reached <= value + (noise * nothing * scale if last else 0.0)
            sound = sound and math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2) <= longest
            if sound or damping > MOST:
                break
            damping = max(4.0 * damping, 1e-2)
        if not sound:
            break
        for i in range(numbers):
            y[i] = moved[i]
        value, damping = reached, 0.25 * damping
        if last and gain * (most / least) ** 2 <= nothing * scale:
            break
        before = gain if last else np.inf
    return value


@inside_kernels
def value_of(M: FloatArray, y: FloatArray) -> float:
    """Value of the form."""
    total, numbers = 0.0, len(y)
    for i in range(numbers):
        row = 0.0
        for j in range(numbers):
            row += M[i, j] * y[j]
        total += y[i] * row
    return total


@inside_kernels
def derive(M: FloatArray, y: FloatArray, slope: FloatArray, H: FloatArray, S: FloatArray) -> None:
    """Write gradient, Hessian and its part from squares, for a rotation about the origin and a translation after it."""
    numbers, many = len(y), len(slope)
    J, MJ, pull = np.zeros((numbers, many)), np.zeros((numbers, many)), np.zeros((TURNS, TURNS))
    for k in range(TURNS):
        # The cross product of axis k with each column of R, and with t; k, up and down follow each other in a circle.
        up, down = (k + 1) % 3, (k + 2) % 3
        for j in range(3):
            J[3 * up + j, k], J[3 * down + j, k] = -y[3 * down + j], y[3 * up + j]
        J[9 + up, k], J[9 + down, k], J[9 + k, 3 + k] = -y[9 + down], y[9 + up], 1.0
    for k in range(many):
        slope[k] = 0.0
    for i in range(numbers):
        pulled = 0.0
        for j in range(numbers):
            pulled += 2.0 * M[i, j] * y[j]
            for k in range(many):
                MJ[i, k] += 2.0 * M[i, j] * J[j, k]
        for k in range(many):
            slope[k] += J[i, k] * pulled
        if i < 12:
            row, start, step = (i // 3, i % 3, 3) if i < 9 else (i - 9, 9, 1)
            for b in range(3):
                pull[row, b] += pulled * y[start + step * b]
    trace = pull[0, 0] + pull[1, 1] + pull[2, 2]
    for k in range(many):
        for m in range(many):
            S[k, m] = 0.0
            for i in range(numbers):
                S[k, m] += J[i, k] * MJ[i, m]
            H[k, m] = S[k, m]
            if k < TURNS and m < TURNS:
                # Two cross products, with axis m and then with k, are e_m e_k^T, less the identity where k is m.
                H[k, m] += 0.5 * (pull[k, m] + pull[m, k]) - (trace if k == m else 0.0)


@inside_kernels
def independent(
    slope: FloatArray,
    H: FloatArray,
    S: FloatArray,
    flat: float,
    curvature: FloatArray,
    strength: FloatArray,
    motions: FloatArray,
) -> int:
    """Write slope, curvature, strength and columns of the independent constrained motions; returns their number."""
    many = len(slope)
    a, axes = np.zeros((many, many)), np.zeros((many, many))
    gradient = slope.copy()
    turn, shift = S[0, 0] + S[1, 1] + S[2, 2], S[3, 3] + S[4, 4] + S[5, 5]
    # Rotations and translations in one unit, so that "flat" means the same for both.
    unit = np.sqrt(shift / turn) if turn > 0.0 and shift > 0.0 else 1.0
    for k in range(many):
        for m in range(many):
            a[k, m] = S[k, m] * (unit if k < TURNS else 1.0) * (unit if m < TURNS else 1.0)
    symmetric_axes(a, axes)
    most, count = 0.0, 0
    for k in range(many):
        most = max(most, a[k, k])
    for k in range(many):
        # The squares decide what is constrained: on a plane the full Hessian has curvature even in a pure slide.
        if a[k, k] > flat * most:
            for i in range(many):
                axes[i, count] = axes[i, k] * (unit if i < TURNS else 1.0)
            count += 1
    a, turned = np.zeros((count, count)), np.zeros((count, count))
    for k in range(count):
        for m in range(count):
            a[k, m] = inner(axes, k, H, axes, m)
    symmetric_axes(a, turned)
    most = 0.0
    for k in range(count):
        curvature[k], slope[k] = abs(a[k, k]), 0.0
        for i in range(many):
            motions[i, k] = 0.0
            for m in range(count):
                motions[i, k] += axes[i, m] * turned[m, k]
            slope[k] += motions[i, k] * gradient[i]
        strength[k] = inner(motions, k, S, motions, k)
        most = max(most, strength[k])
    for k in range(count):
        # Negative curvature is walked down, not up; none at all would make the step endless.
        curvature[k] = max(curvature[k], FLATTEST * most)
    return count


@inside_kernels
def inner(one: FloatArray, k: int, H: FloatArray, other: FloatArray, m: int) -> float:
    """Product of column k, a matrix, and column l."""
    total, many = 0.0, len(H)
    for i in range(many):
        for j in range(many):
            total += one[i, k] * H[i, j] * other[j, m]
    return total


@inside_kernels
def move(y: FloatArray, step: FloatArray, moved: FloatArray) -> None:
    """Write the numbers of the pose after a step: ``exp(w) - 1`` of R and t is added, and the translation."""
    w0, w1, w2 = step[0], step[1], step[2]
    half = 0.5 * math.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    ratio = math.sin(half) / half if half > 0.0 else 1.0
    c, d = ratio * math.cos(half), 0.5 * ratio * ratio
    moved[12] = 1.0
    for j in range(4):
        start, by = (j, 3) if j < 3 else (9, 1)
        a, b, e = y[start], y[start + by], y[start + 2 * by]
        p, q, r = w1 * e - w2 * b, w2 * a - w0 * e, w0 * b - w1 * a
        moved[start] = a + (c * p + d * (w1 * r - w2 * q))
        moved[start + by] = b + (c * q + d * (w2 * p - w0 * r))
        moved[start + 2 * by] = e + (c * r + d * (w0 * q - w1 * p))
    for k in range(3):
        moved[9 + k] += step[3 + k]
