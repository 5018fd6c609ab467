"""Minimum of a quadratic form over all allowed poses: from a given pose, or the global one.

For a given rotation the best translation is linear, and what remains is a quadratic form K of (vec R, 1). Where K is
the same for each row of R, as for points and directions, the closed form of 1991 gives the global minimum. Planes and
lines have several minima: K is evaluated on a fixed grid of rotations, and Newton's method starts from the best that
lie apart.
"""

from __future__ import annotations

import contextlib
import dataclasses
from functools import lru_cache

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._statuses import Status
from dqreg.errors import DegenerateGeometryError
from dqreg.rigid import pose, quaternion, rotations
from dqreg.solvers.closed_form import quaternion_form, rounding_gap, solve_moments
from dqreg.solvers.dof import Freedom
from dqreg.solvers.dof_chart import Flags, FrameMotion, LockedChart, relative, turned
from dqreg.solvers.fit import PoseFit
from dqreg.solvers.motion_words import Motion
from dqreg.solvers.newton import Descent, balance, descend
from dqreg.solvers.quadratic import QuadraticForm

# Curvature below this fraction of the largest is rounding, a hundred times the smallest step of a float. No more,
# because a weak prior beside many exact points is real: 0.1 known beforehand beside 100,000 distances of 1e-5 is 1e-13.
FREE_CURVATURE_RATIO = 2e-14
# An unconstrained motion is a rotation if that much of its unit vector is one: an axis ten levers away still counts,
# rounding not.
MIN_TURN_SHARE = 0.1
# Costs that differ by less, in units of the sums they are differences of, are equal.
EQUAL_COST_SHARE = 1e-13
# Steps off a saddle, tried to either side, in radians (and levers).
SADDLE_STEPS_RAD = (0.3, -0.3)
# How often that is done.
MAX_ESCAPES = 3
# Negative curvature of a smaller share is rounding.
SADDLE_CURVATURE_RATIO = 1e-9
# Rotations of the grid: by a constant axis, by an axis in a plane, by any axis.
GRID = {0: 1, 1: 90, 2: 400, 3: 2000}
# How many of them are followed, and the least angle between any two of those.
MAX_FOLLOWED = 12
APART_RAD = 0.5
# Departure of K from the same block for each row of R that is rounding.
BLOCK_ROUNDING = 1e-13
# Translations with a smaller fraction of the stiffness are unconstrained.
UNFELT_STIFFNESS_RATIO = 1e-12


def minimise(
    form: QuadraticForm,
    near: FloatArray | None,
    freedom: Freedom | None = None,
    reference: FloatArray | None = None,
    flat: float = FREE_CURVATURE_RATIO,
    *,
    escape: bool = True,
) -> PoseFit:
    """Pose of least cost."""
    if freedom is None and form.moments is not None and form.moments.aligned is not None:
        # What is wrong with the pose here is said below, motion by motion.
        with contextlib.suppress(DegenerateGeometryError):
            T = solve_moments(form.moments).T_target_source
            return PoseFit(T, max(form.value(T), 0.0), "closed form", 0, 1, ())
    if freedom is None:
        freedom = Freedom.only("all", frame=form.origin_target)
    if reference is None:
        reference = pose.from_parts(np.eye(3), form.origin_target - form.origin_source)
    freedom = freedom.brought_to(form.origin_target)
    closed = False
    if near is None:
        charts, closed = starts(form, freedom, reference)
    else:
        freely = (freedom.turns, freedom.shifts)
        charts = [
            LockedChart(freedom.frame, reference, freely, relative(freedom.frame, near, reference).within(*freely))
        ]
    ends = [descend(form, chart, flat) for chart in charts]
    level = min(end.value for end in ends) + EQUAL_COST_SHARE * form.scale
    # Of equal minima, the one with the smallest rotation.
    lowest = max((end for end in ends if end.value <= level), key=lambda end: abs(end.chart.motion.q[0]))
    best = _off_saddles(form, lowest, flat) if escape else lowest
    free = free_motions(form, best.chart)
    if near is None and free:
        raise DegenerateGeometryError(
            f"the cost does not determine the pose; unconstrained: {'; '.join(free)}. Add features or a prior that "
            "constrain it, lock it with dof=, or give near= to keep it as it is there"
        )
    status: Status = "closed form" if closed else "converged" if best.converged else "iteration limit"
    return PoseFit(best.chart.pose, max(best.value, 0.0), status, best.iterations, len(charts), free)


def _off_saddles(form: QuadraticForm, end: Descent, flat: float) -> Descent:
    for _ in range(MAX_ESCAPES):
        _, hessian, squares = end.chart.slopes(form)
        unit = balance(squares, end.chart.turns)
        strength, motions = np.linalg.eigh(squares * unit[:, None] * unit)
        # Only along what is constrained: the rest stays as it is.
        motions = unit[:, None] * motions[:, strength > flat * strength.max(initial=0.0)]
        values, vectors = np.linalg.eigh(motions.T @ hessian @ motions)
        if not len(values) or values[0] >= -SADDLE_CURVATURE_RATIO * strength[-1]:
            break
        down = motions @ vectors[:, 0]
        down = down / np.linalg.norm(down[: end.chart.turns])
        lower = min(
            (descend(form, end.chart.moved(side * down), flat) for side in SADDLE_STEPS_RAD),
            key=lambda other: other.value,
        )
        if not lower.value < end.value:
            break
        end = Descent(lower.chart, lower.value, end.iterations + lower.iterations, lower.converged)
    return end


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
    rotated = reference[:3, :3] + axes @ turned(candidates) @ axes.T @ reference[:3, :3]
    z = np.hstack([rotated.reshape(-1, 9), np.ones((len(candidates), 1))])
    chosen = np.zeros(1, dtype=np.int64) if closed else _apart(candidates, np.einsum("ni,ij,nj->n", z, K, z))
    chart = LockedChart(
        freedom.frame, reference, (freedom.turns, freedom.shifts), FrameMotion(candidates[0], np.zeros(3))
    )
    found = []
    for i in chosen:
        t = np.zeros(3)
        t[list(freedom.shifts)] = shift @ z[i]
        found.append(dataclasses.replace(chart, motion=FrameMotion(candidates[i], t).within(*chart.freely)))
    return found, closed


def _lift(form: QuadraticForm, freedom: Freedom, reference: FloatArray) -> FloatArray:
    """(vec R, 1) to the 13 coordinates of the pose that rotates about the frame's origin only, (13, 10)."""
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
    """Free translations of least cost, linear in the 13 coordinates before the translation, (k, 13)."""
    stiffness = along.T @ form.matrix[9:12, 9:12] @ along
    if not stiffness.size:
        return np.zeros((0, 13))
    inverse = np.linalg.pinv(stiffness, rcond=UNFELT_STIFFNESS_RATIO, hermitian=True)
    best: FloatArray = -inverse @ along.T @ form.matrix[9:12]
    return best


def _is_isotropic(K: FloatArray) -> bool:
    blocks = K.reshape(3, 3, 3, 3)
    mean = np.einsum("kikj->ij", blocks) / 3.0
    return bool(np.abs(K - np.kron(np.eye(3), mean)).max() <= BLOCK_ROUNDING * np.abs(K).max())


def _apart(candidates: FloatArray, values: FloatArray) -> FloatArray:
    """The best candidates no two of which are near each other."""
    order = np.argsort(values, kind="stable")
    chosen: list[int] = []
    while len(order) and len(chosen) < MAX_FOLLOWED:
        first = int(order[0])
        chosen.append(first)
        cosines = np.abs(candidates[order] @ candidates[first])
        order = order[cosines < np.cos(0.5 * APART_RAD)]
    return np.array(chosen)


@lru_cache(maxsize=8)
def rotation_grid(turns: Flags) -> FloatArray:
    """Evenly spread rotations, the identity first. Shapes: returns (n, 4)."""
    count = GRID[sum(turns)]
    grid = np.zeros((count, 4))
    k = np.arange(count)
    if sum(turns) <= 1:
        spread = np.column_stack([np.cos(np.pi * k / count), np.sin(np.pi * k / count)])[:, : 1 + sum(turns)]
    elif sum(turns) == 2:
        # A spiral over half a sphere: q and -q are the same rotation.
        height, azimuth_rad = 1.0 - k / count, np.pi * (3.0 - np.sqrt(5.0)) * k
        ring = np.sqrt(1.0 - height**2)
        spread = np.column_stack([height, ring * np.cos(azimuth_rad), ring * np.sin(azimuth_rad)])
    else:
        spread = rotations.evenly_spread(count)
        spread[0] = [1.0, 0.0, 0.0, 0.0]
    grid[:, [0, *(i + 1 for i in range(3) if turns[i])]] = spread
    grid.setflags(write=False)
    return grid


def free_motions(form: QuadraticForm, chart: LockedChart) -> tuple[str, ...]:
    """Allowed motions along which the cost stays as it is, in words."""
    _, hessian, squares = chart.slopes(form)
    unit = balance(squares, chart.turns)
    # At a minimum the Hessian decides: where all points belong to one place every rotation has the same cost, although
    # each residual changes.
    values, vectors = np.linalg.eigh(hessian * unit[:, None] * unit)
    least = FREE_CURVATURE_RATIO * np.abs(squares * unit[:, None] * unit).max(initial=0.0)
    if form.moments is not None and chart.turns:
        # Of points and directions alone the gap is the curvature of the weakest rotation.
        least += rounding_gap(form.moments) * unit[0] ** 2
    free = vectors[:, values <= least]
    if not free.shape[1]:
        return ()
    # Equal eigenvalues mix their motions; the basis with the largest rotations separates rotations from translations.
    free = free @ np.linalg.svd(free[: chart.turns], full_matrices=True)[2].T if chart.turns else free
    shares = np.linalg.norm(free[: chart.turns], axis=0)
    twists = chart.basis @ (unit[:, None] * free)
    twists[3:] += np.cross(twists[:3].T, form.origin_target - chart.pivot).T
    return tuple(
        Motion.of(twist, form.origin_target.tolist(), "rotation" if turns else "translation").words
        for twist, turns in zip(twists.T.tolist(), shares > MIN_TURN_SHARE, strict=True)
    )
