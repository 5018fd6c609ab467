"""Newton's method on poses for a quadratic form, with exact first and second derivatives.

`local_minimum` is compiled and knows all six motions; `descend` keeps a pose within its degrees of freedom.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.solvers.dof_chart import LockedChart
from dqreg.solvers.quadratic import QuadraticForm, Slopes

MAX_STEPS = 200
# A predicted gain below this fraction of the cost's scale is rounding; so is a rise of so many times as much.
NO_GAIN_SHARE = 1e-15
ROUNDING_RISE_RATIO = 100.0
# Longest rotation of one step: a longer one would leap into the neighbouring valley.
LONGEST_RAD = 1.6
# Curvature below this fraction of the largest leaves the motion where it is.
FLAT_CURVATURE_RATIO = 1e-9


@dataclasses.dataclass(frozen=True)
class Descent:
    """Where Newton's method ended."""

    chart: LockedChart  # Holds the pose
    value: float  # Cost there
    iterations: int  # Steps taken
    converged: bool  # Whether the last step was within the rounding of the cost


def local_minimum(form: QuadraticForm, start: FloatArray) -> FloatArray:
    """Pose of least cost near a start.

    Damped Newton steps that never raise the cost; unconstrained motions stay as they are.
    """
    return least_cost(form, start)[0]


def least_cost(form: QuadraticForm, start: FloatArray) -> tuple[FloatArray, float]:
    """The same, and the cost there."""
    from dqreg.kernels.steps.pose_forms import least_cost_pose
    from dqreg.kernels.threads import as_plain

    origins, T = np.array([form.origin_source, form.origin_target]), np.zeros((4, 4))
    limits = MAX_STEPS, NO_GAIN_SHARE, ROUNDING_RISE_RATIO, LONGEST_RAD, FLAT_CURVATURE_RATIO
    cost = least_cost_pose(as_plain(form.matrix), as_plain(origins), as_plain(start), *limits, T)
    return T, cost


def descend(form: QuadraticForm, chart: LockedChart, flat: float = FLAT_CURVATURE_RATIO) -> Descent:
    """Damped Newton steps from where a chart stands."""
    value, damping, before = form.value(chart.pose), 0.0, np.inf
    scale = max(form.scale, abs(value))
    for iteration in range(MAX_STEPS):
        slope, curvature, strength, motions = constrained_motions(chart.slopes(form), chart.turns, flat)
        if not len(slope):
            return Descent(chart, value, iteration, converged=True)
        gain = float(slope @ (slope / curvature))
        last = gain <= NO_GAIN_SHARE * scale
        if last and not gain < 0.25 * before:
            return Descent(chart, value, iteration, converged=True)
        damping = 0.0 if last else damping
        while True:
            step = motions @ (-slope / (curvature + damping * strength))
            candidate = chart.moved(step)
            reached = form.value(candidate.pose)
            # A gain this small is within the rounding of the cost: the step is right even where the cost seems to rise.
            sound = reached <= value + (ROUNDING_RISE_RATIO * NO_GAIN_SHARE * scale if last else 0.0)
            sound = sound and bool(np.linalg.norm(step[: chart.turns]) <= LONGEST_RAD)
            if sound or damping > 1e12:
                break
            damping = max(4.0 * damping, 1e-2)
        if not sound:
            return Descent(chart, value, iteration, converged=last)
        chart, value, damping = candidate, reached, 0.25 * damping
        if last and gain * float(curvature.max() / curvature.min()) ** 2 <= NO_GAIN_SHARE * scale:
            return Descent(chart, value, iteration + 1, converged=True)
        # Where the cost is steep and flat at once, one step within rounding is not enough: on while they shrink.
        before = gain if last else np.inf
    return Descent(chart, value, MAX_STEPS, converged=False)


def constrained_motions(
    slopes: Slopes, turns: int, flat: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Slope, curvature, strength and steps of the independent constrained motions.

    Shapes: slope, curvature (m,), strength (m,), motions (k, m).
    """
    gradient, hessian, squares = slopes
    unit = balance(squares, turns)
    strength, motions = np.linalg.eigh(squares * unit[:, None] * unit)
    # The squares decide what is constrained: on a plane the full Hessian has curvature even in a pure slide.
    motions = unit[:, None] * motions[:, strength > flat * strength.max(initial=0.0)]
    curvature, turned = np.linalg.eigh(motions.T @ hessian @ motions)
    motions = motions @ turned
    strength = np.einsum("ij,ij->j", motions, squares @ motions)
    # Negative curvature is walked down, not up; none at all would make the step endless.
    size = np.maximum(np.abs(curvature), FLAT_CURVATURE_RATIO * strength.max(initial=0.0))
    return motions.T @ gradient, size, strength, motions


def balance(squares: FloatArray, turns: int) -> FloatArray:
    """Factors that bring rotations and translations to one unit, so that "flat" means the same for both.

    Shapes: squares (k, k), returns (k,).
    """
    held = np.diag(squares)
    turned, shifted = float(held[:turns].sum()), float(held[turns:].sum())
    unit = np.ones(len(squares))
    if turned > 0.0 and shifted > 0.0:
        unit[:turns] = np.sqrt(shifted / turned * turns / (len(squares) - turns))
    return unit
