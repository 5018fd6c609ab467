"""Minimum zone, inscribed and circumscribed shapes: linear programs about the shape until none is better."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import DegenerateGeometryError
from dqreg.inspection.features.gauss import along_axis
from dqreg.inspection.features.models import PARAMETERS, FeatureKind, Shape, distances

ZoneMethod = Literal["chebyshev", "inscribed", "circumscribed"]

# Linear programs at most, and the gain, in sizes of the points, that ends them.
MAX_PROGRAMS, CONVERGED_GAIN_SIZES = 60, 1e-14
# The first trust region, and the largest; it is quartered where a step does not gain and doubled where it does.
MAX_TRUST_SIZES = 0.3
# Points that enter a program: those with the largest distances; more are added while any other one is violated.
MAX_JOINING_POINTS = 400
# Points whose directions enter the program of a line at once.
LINE_POINTS = 20
# Directions that it begins with, and the tolerance of its programs, which may be no finer.
PRISM_SIDES = 24
LP_TOLERANCE = 1e-10
# What those programs leave where they end, in heights.
LP_ROUNDING = 1e-10
# A step in sizes, and the share of it that a shape which points hold on all sides does not gain.
PROBE_STEP_SIZES, MAX_PROBE_GAIN_SHARE = 1e-3, 0.01


@dataclasses.dataclass(frozen=True, eq=False)
class ZoneProblem:
    """Least h with ``sign f_i <= h`` for all rows: distances both ways, from within, or from without."""

    kind: FeatureKind
    method: ZoneMethod
    points: FloatArray

    def rows(self, shape: Shape) -> tuple[FloatArray, FloatArray]:
        """What must not exceed h, and its derivatives; an inscribed or circumscribed shape leaves the radius to h."""
        return self.of_distances(*distances(self.kind, shape, self.points), shape.radius)

    def of_distances(self, values: FloatArray, slopes: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
        """The same from the distances of the points."""
        if self.kind == "circle":
            # The zone lies within the plane of the circle, which the least squares fit gave.
            values, slopes = values[len(self.points) :], slopes[len(self.points) :]
        slopes = slopes[:, self.free]
        if self.method == "chebyshev":
            return np.concatenate([values, -values]), np.concatenate([slopes, -slopes])
        return self.sign * (values + radius), self.sign * slopes

    @property
    def sign(self) -> float:
        """Of the radius in the height of an inscribed or circumscribed shape."""
        return 1.0 if self.method == "circumscribed" else -1.0

    @property
    def free(self) -> IntArray:
        """Columns of the parameters that the program moves."""
        fixed = {"tilt_x", "tilt_y", "shift_z"} if self.kind == "circle" else set()
        fixed |= {"radius"} if self.method != "chebyshev" else set()
        return np.array([k for k, name in enumerate(PARAMETERS[self.kind]) if name not in fixed])

    def height(self, shape: Shape) -> float:
        """The h of a shape; of a line the radius of the cylinder about it."""
        if self.kind == "line":
            return float(np.hypot(*distances("line", shape, self.points)[0].reshape(2, -1)).max())
        return float(self.rows(shape)[0].max())

    def step(self, shape: Shape, trust: float) -> FloatArray:
        """The step within the trust region that gains most, to first order: all parameters, (k,)."""
        full = np.zeros(len(PARAMETERS[self.kind]))
        if self.kind == "line":
            return tube_step(*distances("line", shape, self.points), trust)
        full[self.free] = chebyshev_step(*self.rows(shape), trust)
        return full

    def promised(self, shape: Shape, step: FloatArray) -> float:
        """The h that a step leads to, to first order."""
        if self.kind == "line":
            values, slopes = distances("line", shape, self.points)
            return float(np.hypot(*(values + slopes @ step).reshape(2, -1)).max())
        values, slopes = self.rows(shape)
        return float((values + slopes @ step[self.free]).max())


def chebyshev_step(values: FloatArray, slopes: FloatArray, trust: float) -> FloatArray:
    """The step within a trust region after which the largest value is least. Shapes: (r,), (r, k), returns (k,)."""
    from scipy.optimize import linprog

    count = slopes.shape[1]
    bounds = [(-trust, trust)] * count + [(None, None)]
    chosen = np.argsort(-values, kind="stable")[:MAX_JOINING_POINTS]
    while True:
        rows = np.column_stack([slopes[chosen], -np.ones(len(chosen))])
        found = linprog(np.r_[np.zeros(count), 1.0], A_ub=rows, b_ub=-values[chosen], bounds=bounds, method="highs")
        if found.x is None:
            return np.zeros(count)
        short = values + slopes @ found.x[:-1] - found.x[-1]
        short[chosen] = -np.inf
        missed = np.flatnonzero(short > 1e-13)
        if not len(missed):
            return np.asarray(found.x[:-1], dtype=np.float64)
        chosen = np.concatenate([chosen, missed[np.argsort(-short[missed], kind="stable")][:MAX_JOINING_POINTS]])


def tube_step(values: FloatArray, slopes: FloatArray, trust: float) -> FloatArray:
    """The step to the least cylinder about points, to first order, from both components of their distances: (4,).

    The length of a distance is the largest of its components along all directions: those that matter are added one
    after the other (cutting planes; Kelley 1960).
    """
    from scipy.optimize import linprog

    # In units of the height: the programs' tolerance is absolute.
    unit = float(np.hypot(*values.reshape(2, -1)).max()) or 1.0
    parts, changes = values.reshape(2, -1) / unit, slopes.reshape(2, -1, slopes.shape[1])
    trust = trust / unit
    step, last = np.zeros(slopes.shape[1]), np.inf
    rows: list[FloatArray] = []
    bounds: list[FloatArray] = []
    limits = [(-trust, trust)] * len(step) + [(None, None)]
    for _ in range(MAX_PROGRAMS):
        moved = parts + changes @ step
        sizes = np.hypot(*moved)
        worst = np.argsort(-sizes, kind="stable")[:LINE_POINTS]
        across = moved[:, worst] / np.maximum(sizes[worst], np.finfo(float).tiny)
        if not rows:
            # At first along even directions: the cylinder lies within a prism.
            turns = 2.0 * np.pi / PRISM_SIDES * np.repeat(np.arange(PRISM_SIDES), len(worst))
            worst, across = np.tile(worst, PRISM_SIDES), np.stack([np.cos(turns), np.sin(turns)])
        rows.append(np.column_stack([np.einsum("jw,jwk->wk", across, changes[:, worst]), -np.ones(len(worst))]))
        bounds.append(-np.einsum("jw,jw->w", across, parts[:, worst]))
        goal = np.r_[np.zeros(len(step)), 1.0]
        found = linprog(
            goal,
            np.vstack(rows),
            np.concatenate(bounds),
            bounds=limits,
            method="highs",
            options={"primal_feasibility_tolerance": LP_TOLERANCE, "dual_feasibility_tolerance": LP_TOLERANCE},
        )
        if found.x is None:
            break
        step = np.asarray(found.x[:-1], dtype=np.float64)
        gap = float(np.hypot(*(parts + changes @ step)).max() - found.x[-1])
        # A gap of the programs' rounding closes no more.
        if gap <= CONVERGED_GAIN_SIZES or (gap < LP_ROUNDING and gap > 0.5 * last):
            break
        last = gap
    return unit * step


def _surrounded(problem: ZoneProblem, gauss: Shape) -> bool:
    """Whether points lie on all sides of a shape: their normals span space positively (Davis 1954).

    The hull of the unit normals holds 0 within. Whether form error lets an inscribed shape slide out all the same is
    asked of the fitted one: no step may gain.
    """
    from scipy.spatial import ConvexHull, QhullError

    local = gauss.local(problem.points)[:, : 3 if problem.kind == "sphere" else 2]
    lengths = np.linalg.norm(local, axis=1)
    try:
        hull = ConvexHull(local / np.maximum(lengths, np.finfo(float).tiny)[:, None])
    except QhullError:
        return False
    return float(-hull.equations[:, -1].max()) > LP_ROUNDING


def _not_surrounded(kind: FeatureKind, method: ZoneMethod) -> DegenerateGeometryError:
    words = (
        "has no largest size: it slides out of" if method == "inscribed" else "is no more than what holds the ends of"
    )
    more = ", or more by less than their form error" if method == "inscribed" else ""
    return DegenerateGeometryError(
        f"the {method} {kind} {words} these points, which do not surround it (half of the way round at most{more}); "
        "measure more of it, or fit it by least squares (gauss)"
    )


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
    problem = ZoneProblem(kind, method, (points - centre) / size)
    if method != "chebyshev" and not _surrounded(problem, shape):
        raise _not_surrounded(kind, method)
    height, trust = problem.height(shape), MAX_TRUST_SIZES
    for _ in range(MAX_PROGRAMS):
        step = problem.step(shape, trust)
        if height - problem.promised(shape, step) <= CONVERGED_GAIN_SIZES:
            break
        moved = shape.moved(kind, step)
        new = problem.height(moved)
        if new < height:
            gained, shape, height, trust = height - new, moved, new, min(2.0 * trust, MAX_TRUST_SIZES)
            if gained < CONVERGED_GAIN_SIZES:
                break
        else:
            trust *= 0.25
            if trust < CONVERGED_GAIN_SIZES:
                break
    radius = shape.radius
    if method != "chebyshev":
        gain = height - problem.promised(shape, problem.step(shape, PROBE_STEP_SIZES))
        if gain > MAX_PROBE_GAIN_SHARE * PROBE_STEP_SIZES:
            raise _not_surrounded(kind, method)
        radius = height if method == "circumscribed" else -height
    half = size * shape.half_length
    shape = Shape(centre + size * shape.point, shape.frame, size * radius, shape.half_angle, half)
    return along_axis(shape, float((centre - shape.point) @ shape.axis)) if kind in ("cylinder", "cone") else shape
