"""Newton's method on a pose for a quadratic form of its numbers, all six motions free."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiled import compiled
from dqreg.kernels.symmetric_axes import symmetric_axes

# Numbers of a pose, (vec R, t, 1), and its motions: a rotation about the origin, then a translation.
NUMBERS, MOTIONS, TURNS = 13, 6, 3
# Most damping of a step; curvature counts as this share of the largest strength at least.
MOST, FLATTEST = 1e12, 1e-9


@compiled
def newton_steps(
    M: FloatArray, y: FloatArray, scale: float, steps: int, nothing: float, noise: float, longest: float, flat: float
) -> float:
    """Bring the numbers of a pose, (13,), to the least value of ``y^T M y`` near them; returns that value.

    Damped steps that never raise the value; motions whose squares are below ``flat`` of the largest stay as they are.
    """
    slope, H, S = np.zeros(MOTIONS), np.zeros((MOTIONS, MOTIONS)), np.zeros((MOTIONS, MOTIONS))
    curvature, strength, motions = np.zeros(MOTIONS), np.zeros(MOTIONS), np.zeros((MOTIONS, MOTIONS))
    step, moved = np.zeros(MOTIONS), np.zeros(NUMBERS)
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
            for i in range(MOTIONS):
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
        for i in range(NUMBERS):
            y[i] = moved[i]
        value, damping = reached, 0.25 * damping
        if last and gain * (most / least) ** 2 <= nothing * scale:
            break
        before = gain if last else np.inf
    return value


@compiled
def value_of(M: FloatArray, y: FloatArray) -> float:
    """Value of the form."""
    total = 0.0
    for i in range(NUMBERS):
        row = 0.0
        for j in range(NUMBERS):
            row += M[i, j] * y[j]
        total += y[i] * row
    return total


@compiled
def derive(M: FloatArray, y: FloatArray, slope: FloatArray, H: FloatArray, S: FloatArray) -> None:
    """Write gradient, Hessian and its part from squares, for a rotation about the origin and a translation after it."""
    J, MJ, pull = np.zeros((NUMBERS, MOTIONS)), np.zeros((NUMBERS, MOTIONS)), np.zeros((TURNS, TURNS))
    for k in range(TURNS):
        # The cross product of axis k with each column of R, and with t; k, up and down follow each other in a circle.
        up, down = (k + 1) % 3, (k + 2) % 3
        for j in range(3):
            J[3 * up + j, k], J[3 * down + j, k] = -y[3 * down + j], y[3 * up + j]
        J[9 + up, k], J[9 + down, k], J[9 + k, 3 + k] = -y[9 + down], y[9 + up], 1.0
    for k in range(MOTIONS):
        slope[k] = 0.0
    for i in range(NUMBERS):
        pulled = 0.0
        for j in range(NUMBERS):
            pulled += 2.0 * M[i, j] * y[j]
            for k in range(MOTIONS):
                MJ[i, k] += 2.0 * M[i, j] * J[j, k]
        for k in range(MOTIONS):
            slope[k] += J[i, k] * pulled
        if i < 12:
            row, start, step = (i // 3, i % 3, 3) if i < 9 else (i - 9, 9, 1)
            for b in range(3):
                pull[row, b] += pulled * y[start + step * b]
    trace = pull[0, 0] + pull[1, 1] + pull[2, 2]
    for k in range(MOTIONS):
        for m in range(MOTIONS):
            S[k, m] = 0.0
            for i in range(NUMBERS):
                S[k, m] += J[i, k] * MJ[i, m]
            H[k, m] = S[k, m]
            if k < TURNS and m < TURNS:
                # Two cross products, with axis m and then with k, are e_m e_k^T, less the identity where k is m.
                H[k, m] += 0.5 * (pull[k, m] + pull[m, k]) - (trace if k == m else 0.0)


@compiled
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
    a, axes, turned = np.zeros((MOTIONS, MOTIONS)), np.zeros((MOTIONS, MOTIONS)), np.zeros((MOTIONS, MOTIONS))
    gradient = slope.copy()
    turn, shift = S[0, 0] + S[1, 1] + S[2, 2], S[3, 3] + S[4, 4] + S[5, 5]
    # Rotations and translations in one unit, so that "flat" means the same for both.
    unit = np.sqrt(shift / turn) if turn > 0.0 and shift > 0.0 else 1.0
    for k in range(MOTIONS):
        for m in range(MOTIONS):
            a[k, m] = S[k, m] * (unit if k < TURNS else 1.0) * (unit if m < TURNS else 1.0)
    symmetric_axes(a, axes, MOTIONS)
    most, count = 0.0, 0
    for k in range(MOTIONS):
        most = max(most, a[k, k])
    for k in range(MOTIONS):
        # The squares decide what is constrained: on a plane the full Hessian has curvature even in a pure slide.
        if a[k, k] > flat * most:
            for i in range(MOTIONS):
                axes[i, count] = axes[i, k] * (unit if i < TURNS else 1.0)
            count += 1
    for k in range(count):
        for m in range(count):
            a[k, m] = inner(axes, k, H, axes, m)
    symmetric_axes(a, turned, count)
    most = 0.0
    for k in range(count):
        curvature[k], slope[k] = abs(a[k, k]), 0.0
        for i in range(MOTIONS):
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


@compiled
def inner(one: FloatArray, k: int, H: FloatArray, other: FloatArray, m: int) -> float:
    """Product of column k, a matrix, and column l."""
    total = 0.0
    for i in range(MOTIONS):
        for j in range(MOTIONS):
            total += one[i, k] * H[i, j] * other[j, m]
    return total


@compiled
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
