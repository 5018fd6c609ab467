"""Minimum of a quadratic form over all allowed poses: from a pose given, or the lowest of all."""

from __future__ import annotations

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.rigid import pose
from dqreg.solvers.cost_fit import PoseFit
from dqreg.solvers.cost_motions import FREE, free_motions
from dqreg.solvers.cost_search import starts
from dqreg.solvers.freedom import Freedom
from dqreg.solvers.freedom_motion import LockedChart, relative
from dqreg.solvers.pose_newton import Descent, balance, descend
from dqreg.solvers.quadratic import QuadraticForm

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
            f"the cost does not determine the pose: it stays the same under a {'; and under a '.join(free)}. Add "
            "features or a prior that feel it, lock it with dof=, or give near= to keep it as it is there"
        )
    status = "closed form" if closed else "converged" if best.converged else "iteration limit"
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
