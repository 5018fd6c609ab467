"""Starts for the global minimum of a quadratic form over all allowed motions.

For a given turn the best shift is linear, and what remains is a quadratic form K of (vec R, 1). Where K is the same for
each row of R, as for points and directions, the closed form of 1991 gives the global minimum. Planes and lines have
several minima: K is looked up on a fixed grid of turns, and Newton's method goes down from the best that lie apart.
"""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import quaternion, rotations
from dqreg.solvers.closed_form import quaternion_form
from dqreg.solvers.dof import Freedom
from dqreg.solvers.dof_chart import Flags, LockedChart, Motion, turned
from dqreg.solvers.quadratic import QuadraticForm

# Turns looked up: by a constant axis, by an axis in a plane, by any axis.
GRID = {0: 1, 1: 90, 2: 400, 3: 2000}
# How many of them are followed, and the least angle between any two of those.
FOLLOWED = 12
APART_RAD = 0.5
# Departure of K from the same block for each row of R that is rounding.
ROUNDING = 1e-13
# Shifts with a smaller share of the stiffness are not felt.
UNFELT = 1e-12


def starts(form: QuadraticForm, freedom: Freedom, reference: FloatArray) -> tuple[list[LockedChart], bool]:
    """Allowed poses, one of them near the global minimum."""
    axes = freedom.frame[:3, :3]
    lift = _lift(form, freedom, reference)
    shift = _best_shift(form, axes[:, list(freedom.shifts)]) @ lift
    full = lift.copy()
    full[9:12] += axes[:, list(freedom.shifts)] @ shift
    K = full.T @ form.matrix @ full
    candidates = rotation_grid(freedom.turns)
    closed = False
    if all(freedom.turns):
        R = quaternion.to_matrix(np.linalg.eigh(quaternion_form(-K[:9, 9].reshape(3, 3)))[1][:, 3])
        candidates = np.vstack([quaternion.from_matrix(axes.T @ R @ reference[:3, :3].T @ axes), candidates])
        closed = _is_isotropic(K[:9, :9])
    rotations = reference[:3, :3] + axes @ turned(candidates) @ axes.T @ reference[:3, :3]
    z = np.hstack([rotations.reshape(-1, 9), np.ones((len(candidates), 1))])
    chosen = np.zeros(1, dtype=np.int64) if closed else _apart(candidates, np.einsum("ni,ij,nj->n", z, K, z))
    chart = LockedChart(freedom.frame, reference, (freedom.turns, freedom.shifts), Motion(candidates[0], np.zeros(3)))
    found = []
    for i in chosen:
        t = np.zeros(3)
        t[list(freedom.shifts)] = shift @ z[i]
        found.append(dataclasses.replace(chart, motion=Motion(candidates[i], t).within(*chart.freely)))
    return found, closed


def _lift(form: QuadraticForm, freedom: Freedom, reference: FloatArray) -> FloatArray:
    """(vec R, 1) to the 13 coordinates of the pose that turns about the frame's origin, before the shift; (13, 10)."""
    pivot = freedom.frame[:3, 3]
    # From the source point that lies at the frame's origin to the source origin of the form.
    arm = form.origin_source - reference[:3, :3].T @ (pivot - reference[:3, 3])
    lift = np.zeros((13, 10))
    lift[:9, :9] = np.eye(9)
    lift[9:12, :9] = np.kron(np.eye(3), arm)
    lift[9:12, 9] = pivot - form.origin_target
    lift[12, 9] = 1.0
    return lift


def _best_shift(form: QuadraticForm, along: FloatArray) -> FloatArray:
    """Free shifts of least cost, linear in the 13 coordinates before the shift, (k, 13)."""
    stiffness = along.T @ form.matrix[9:12, 9:12] @ along
    if not stiffness.size:
        return np.zeros((0, 13))
    best: FloatArray = -np.linalg.pinv(stiffness, rcond=UNFELT, hermitian=True) @ along.T @ form.matrix[9:12]
    return best


def _is_isotropic(K: FloatArray) -> bool:
    blocks = K.reshape(3, 3, 3, 3)
    mean = np.einsum("kikj->ij", blocks) / 3.0
    return bool(np.abs(K - np.kron(np.eye(3), mean)).max() <= ROUNDING * np.abs(K).max())


def _apart(candidates: FloatArray, values: FloatArray) -> FloatArray:
    """The best candidates no two of which are near each other."""
    order = np.argsort(values, kind="stable")
    chosen: list[int] = []
    while len(order) and len(chosen) < FOLLOWED:
        first = int(order[0])
        chosen.append(first)
        cosines = np.abs(candidates[order] @ candidates[first])
        order = order[cosines < np.cos(0.5 * APART_RAD)]
    return np.array(chosen)


@lru_cache(maxsize=8)
def rotation_grid(turns: Flags) -> FloatArray:
    """Evenly spread turns, the identity first.

    Shapes: returns (n, 4).
    """
    count = GRID[sum(turns)]
    grid = np.zeros((count, 4))
    k = np.arange(count)
    if sum(turns) <= 1:
        spread = np.column_stack([np.cos(np.pi * k / count), np.sin(np.pi * k / count)])[:, : 1 + sum(turns)]
    elif sum(turns) == 2:
        # A spiral over half a sphere: q and -q turn alike.
        height, azimuth_rad = 1.0 - k / count, np.pi * (3.0 - np.sqrt(5.0)) * k
        ring = np.sqrt(1.0 - height**2)
        spread = np.column_stack([height, ring * np.cos(azimuth_rad), ring * np.sin(azimuth_rad)])
    else:
        spread = rotations.evenly_spread(count)
        spread[0] = [1.0, 0.0, 0.0, 0.0]
    grid[:, [0, *(i + 1 for i in range(3) if turns[i])]] = spread
    grid.setflags(write=False)
    return grid
