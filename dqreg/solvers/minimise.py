"""Minimum of a quadratic form over all allowed poses: from a pose given, or the lowest of all."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.rigid import pose
from dqreg.solvers.dof import Freedom
from dqreg.solvers.dof_chart import LockedChart, relative
from dqreg.solvers.motion_words import Motion
from dqreg.solvers.newton import Descent, balance, descend
from dqreg.solvers.newton_starts import starts
from dqreg.solvers.pose_cost_rows import PoseFit
from dqreg.solvers.quadratic import QuadraticForm
from dqreg.solvers.status import Status

# Curvature below this share of the largest is rounding, a hundred times the smallest step of a float. No more, because
# a weak prior beside many exact points is real: 0.1 known beforehand beside 100,000 distances of 1e-5 is 1e-13.
FREE = 2e-14
# A free motion is a turn if that much of its unit vector is one: an axis ten levers away still counts, rounding not.
TURN = 0.1


def free_motions(form: QuadraticForm, chart: LockedChart) -> tuple[str, ...]:
    """Name the allowed motions along which the cost stays as it is."""
    _, hessian, squares = chart.slopes(form)
    unit = balance(squares, chart.turns)
    # At a minimum the Hessian decides: where all points belong to one place every turn has the same cost, although
    # each residual changes.
    values, vectors = np.linalg.eigh(hessian * unit[:, None] * unit)
    largest = np.abs(squares * unit[:, None] * unit).max(initial=0.0)
    free = vectors[:, values <= FREE * largest]
    if not free.shape[1]:
        return ()
    # Equal eigenvalues mix their motions; the basis with turns as large as can be comes apart into turns and shifts.
    free = free @ np.linalg.svd(free[: chart.turns], full_matrices=True)[2].T if chart.turns else free
    shares = np.linalg.norm(free[: chart.turns], axis=0)
    twists = chart.basis @ (unit[:, None] * free)
    twists[3:] += np.cross(twists[:3].T, form.origin_target - chart.pivot).T
    return tuple(
        Motion.of(twist[:3], twist[3:], form.origin_target, "rotation" if share > TURN else "translation").words
        for twist, share in zip(twists.T, shares, strict=True)
    )


# Costs that differ by less, in units of the sums they are differences of, are equal.
EQUAL = 1e-13
# Steps off a place where the cost is level but not least, tried to either side, in radians (and levers).
ASIDE = (0.3, -0.3)
# How often that is done.
ESCAPES = 3
# Negative curvature of a smaller share is rounding.
SADDLE = 1e-9


def minimise(
    form: QuadraticForm,
    near: FloatArray | None,
    freedom: Freedom | None = None,
    reference: FloatArray | None = None,
    flat: float = FREE,
    *,
    escape: bool = True,
) -> PoseFit:
    """Pose of least cost."""
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
    level = min(end.value for end in ends) + EQUAL * form.scale
    # Of equal minima, the one that turns least.
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


def _off_saddles(form: QuadraticForm, end: Descent[LockedChart], flat: float) -> Descent[LockedChart]:
    for _ in range(ESCAPES):
        _, hessian, squares = end.chart.slopes(form)
        unit = balance(squares, end.chart.turns)
        strength, motions = np.linalg.eigh(squares * unit[:, None] * unit)
        # Only along what is felt: the rest stays as it is.
        motions = unit[:, None] * motions[:, strength > flat * strength.max(initial=0.0)]
        values, vectors = np.linalg.eigh(motions.T @ hessian @ motions)
        if not len(values) or values[0] >= -SADDLE * strength[-1]:
            break
        down = motions @ vectors[:, 0]
        down = down / np.linalg.norm(down[: end.chart.turns])
        lower = min(
            (descend(form, end.chart.moved(side * down), flat) for side in ASIDE), key=lambda other: other.value
        )
        if not lower.value < end.value:
            break
        end = Descent(lower.chart, lower.value, end.iterations + lower.iterations, lower.converged)
    return end
