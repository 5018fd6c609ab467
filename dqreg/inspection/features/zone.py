"""Minimum zone, inscribed and circumscribed shapes: linear programs about the shape until none is better."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.inspection.features.gauss import along_axis
from dqreg.inspection.features.models import PARAMETERS, FeatureKind, Shape, distances

ZoneMethod = Literal["chebyshev", "inscribed", "circumscribed"]

# Linear programs at most, and the gain, in sizes of the points, that ends them.
ROUNDS, ENOUGH = 60, 1e-14
# The first trust region, in sizes; it is halved where a step does not gain and doubled where it does.
TRUST = 0.3
# Points that enter a program: those with the largest distances; more are added while any other one is violated.
ACTIVE = 400


@dataclasses.dataclass(frozen=True, eq=False)
class _Problem:
    """Least h with ``sign f_i <= h`` for all rows: distances both ways, from within, or from without."""

    kind: FeatureKind
    method: ZoneMethod
    points: FloatArray

    def rows(self, shape: Shape) -> tuple[FloatArray, FloatArray]:
        """What must not exceed h, and its derivatives; an inscribed or circumscribed shape leaves the radius to h."""
        values, slopes = distances(self.kind, shape, self.points)
        if self.kind == "circle":
            # The zone lies within the plane of the circle, which the least squares fit gave.
            values, slopes = values[len(self.points) :], slopes[len(self.points) :]
        slopes = slopes[:, self.free]
        if self.method == "chebyshev":
            return np.concatenate([values, -values]), np.concatenate([slopes, -slopes])
        sign = 1.0 if self.method == "circumscribed" else -1.0
        # A line has two components and no radius: its zone is the least cylinder about it.
        return sign * (values + shape.radius), sign * slopes

    @property
    def free(self) -> IntArray:
        """Columns of the parameters that the program moves."""
        fixed = {"tilt_x", "tilt_y", "shift_z"} if self.kind == "circle" else set()
        fixed |= {"radius"} if self.method != "chebyshev" else set()
        return np.array([k for k, name in enumerate(PARAMETERS[self.kind]) if name not in fixed])

    def height(self, shape: Shape) -> float:
        """The h of a shape."""
        return float(self.rows(shape)[0].max())

    def step(self, shape: Shape, trust: float) -> FloatArray:
        """The step within the trust region that gains most, to first order: all parameters, (k,)."""
        from scipy.optimize import linprog

        values, slopes = self.rows(shape)
        count = slopes.shape[1]
        chosen = np.argsort(-values, kind="stable")[:ACTIVE]
        while True:
            bounds = [(-trust, trust)] * count + [(None, None)]
            rows = np.column_stack([slopes[chosen], -np.ones(len(chosen))])
            found = linprog(np.r_[np.zeros(count), 1.0], A_ub=rows, b_ub=-values[chosen], bounds=bounds, method="highs")
            full = np.zeros(len(PARAMETERS[self.kind]))
            if found.x is None:
                return full
            short = values + slopes @ found.x[:-1] - found.x[-1]
            short[chosen] = -np.inf
            missed = np.flatnonzero(short > 1e-13)
            if not len(missed):
                full[self.free] = found.x[:-1]
                return full
            chosen = np.concatenate([chosen, missed[np.argsort(-short[missed], kind="stable")][:ACTIVE]])


def fit_zone(kind: FeatureKind, method: ZoneMethod, points: FloatArray, gauss: Shape) -> Shape:
    """The shape of least form error, or the largest inside or the least outside the points, from the least squares one.

    ``chebyshev``: the largest absolute distance is the least possible. ``inscribed``: the largest radius with no point
    inside; ``circumscribed``: the least with no point outside (circles, cylinders, spheres). The optimum is the one of
    the basin in which the least squares fit lies.
    """
    centre = points.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((points - centre) ** 2, axis=1)))) or 1.0
    place, half = (gauss.point - centre) / size, gauss.half_length / size
    shape = Shape(place, gauss.frame, gauss.radius / size, gauss.half_angle, half)
    problem = _Problem(kind, method, (points - centre) / size)
    height, trust = problem.height(shape), TRUST
    for _ in range(ROUNDS):
        moved = shape.moved(kind, problem.step(shape, trust))
        new = problem.height(moved)
        if new < height:
            gained, shape, height, trust = height - new, moved, new, min(2.0 * trust, TRUST)
            if gained < ENOUGH:
                break
        else:
            trust *= 0.25
            if trust < ENOUGH:
                break
    radius = shape.radius
    if method != "chebyshev":
        radius = height if method == "circumscribed" else -height
    half = size * shape.half_length
    shape = Shape(centre + size * shape.point, shape.frame, size * radius, shape.half_angle, half)
    return along_axis(shape, float((centre - shape.point) @ shape.axis)) if kind in ("cylinder", "cone") else shape
