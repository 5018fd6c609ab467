"""Alignments of a scan to chosen faces of its part: best fit, tolerance fit, minimax, all outside or all inside."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError, InputError, did_you_mean
from dqreg.geometry import Mesh
from dqreg.inspection.alignment.earlier_steps import with_kept
from dqreg.inspection.alignment.priors import prior_about
from dqreg.inspection.alignment.surface_covariance import covariance_of
from dqreg.inspection.alignment.surface_goals import PRIOR_SIGMAS, minimax_step, one_sided_excess, one_sided_step
from dqreg.inspection.alignment.surface_rows import FaceTerms, SurfaceRows, rows_of
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.deviations.outward_side import require_sides
from dqreg.rigid import pose
from dqreg.solvers import Freedom, PoseCost

Goal = Literal["best-fit", "tolerance", "minimax", "outside", "inside"]

# Steps at most, and the step that ends them, in radians and sizes of the part.
MAX_STEPS, CONVERGED_STEP = 100, 1e-12
# The gain of a largest deviation that ends them, or a step that may be no longer.
CONVERGED_GAIN_DIAGONALS = 1e-13
# A step that does not gain shortens the next one by that factor; the first may be that long, in sizes.
STEP_SHRINK_FACTOR, MAX_STEP_DIAGONALS = 0.25, 0.05
# The tolerance fit first pulls all points that are out, then forgets those that are out by more than a width that
# shrinks by this factor down to that share of the narrowest band.
WIDTH_SHRINK_FACTOR, MIN_WIDTH_BANDS = 0.6, 0.1
# Pull to the middle of the bands beside that of what exceeds them, in costs of half a band.
CENTRING_COST_RATIO = 1e-3
# Steps at each width, and the one that ends them, in sizes of the part.
STEPS_PER_WIDTH, SETTLED_STEP = 8, 1e-8


@dataclasses.dataclass(frozen=True, eq=False)
class SurfaceAlignment:
    """The pose of a scan on chosen faces of its part.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        From the registered scan to the aligned one, in the caller's target frame.
    covariance : ndarray, (6, 6)
        Of the left increment about ``centre`` (rotation vector, then translation); 0 along locked motions.
    centre : ndarray, (3,)
        Middle of the part.
    goal : {"best-fit", "tolerance", "minimax", "outside", "inside"}
        What is least or largest.
    points : int
        Scan points that it rests on.
    rms, largest : float
        Of the deviations on the chosen faces after it, target units; of medians of 25 neighbouring points where the
        goal is minimax, outside or inside.
    share_within : float or None
        Share of the points within their bands; None where no bands were given.
    converged : bool
        Whether the last step was below 1e-12 of the part's size, or gained nothing.
    """

    T_target_source: FloatArray
    covariance: FloatArray
    centre: FloatArray
    goal: Goal
    points: int
    rms: float
    largest: float
    share_within: float | None
    converged: bool


def align_surface(
    deviations: Deviations,
    goal: Goal = "best-fit",
    *,
    faces: Mapping[int, FaceTerms] | None = None,
    dof: Freedom | str | None = None,
    prior: tuple[ArrayLike, ArrayLike] | None = None,
) -> SurfaceAlignment:
    """Lay a registered scan on chosen faces of its part.

    ``best-fit`` is the least weighted sum of squared distances; ``tolerance`` has the most points within the bands of
    their faces, and of such poses one in the middle of the bands; ``minimax`` the smallest largest deviation, in
    half-widths where faces have bands; ``outside`` and ``inside`` the best fit with no place of the scan below, or
    above, the part's surface by more than its band's limit (0 by default): no gouging. The last three take medians of
    25 neighbouring points, which single points do not move.

    Parameters
    ----------
    deviations : Deviations
        From `dqreg.Registration.deviations`, of a scan on a mesh: its pose is where the alignment begins, and tells
        which points are on which face.
    goal : {"best-fit", "tolerance", "minimax", "outside", "inside"}
        What is least or largest.
    faces : mapping of int to FaceTerms, optional
        Faces by their number, each with its weight and band. Default: all, weight 1, no bands.
    dof : Freedom or str, optional
        Degrees of freedom away from the registered pose; the others keep it exactly.
    prior : (pose, covariance), optional
        A pose in the sense of ``T_target_source`` known beforehand, as in `PoseCost.prior` about the part's middle.
        Where the goal is minimax it may be left by two standard deviations at most.

    Returns
    -------
    SurfaceAlignment
        With its covariance, from how the deviations scatter between patches; of ``minimax`` from the fit repeated with
        the noise of its medians drawn again, and on surfaces that the points allow for between them; where form error
        exceeds the noise of few points it may still be too small by two, because another place may be the farthest.

    Raises
    ------
    InputError
        If the target is no mesh, a face is not on the part, the tolerance fit has no bands, or one side is asked for of
        a mesh that has no inside.
    DegenerateGeometryError
        If the faces were not scanned, or leave a degree of freedom unconstrained; the message names it.

    Examples
    --------
    >>> from dqreg.geometry import Mesh, MeshSurface, sample_mesh
    >>> from dqreg.inspection import measure_deviations
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((30.0, 20.0, 10.0)))
    >>> scan = sample_mesh(part, 600, np.random.default_rng(0)).points + [0.01, 0.0, 0.02]
    >>> found = align_surface(measure_deviations(scan, part, MeshSurface(part)), "minimax")
    >>> bool(abs(found.T_target_source[:3, 3] + [0.01, 0.0, 0.02]).max() < 1e-9), found.largest < 1e-9
    (True, True)
    """
    if goal not in get_args(Goal):
        words = get_args(Goal)
        raise InputError(f"goal must be one of {', '.join(words)}; got {goal!r}{did_you_mean(str(goal), words)}")
    rows = rows_of(deviations, faces)
    if goal in ("outside", "inside"):
        assert isinstance(deviations.target, Mesh)
        require_sides(deviations.target, f"alignments to the {goal}")
    if goal == "tolerance" and not np.isfinite(rows.high - rows.low).all():
        raise InputError("a tolerance fit needs a band for each of its faces: give tolerance, or plus and minus")
    free = Freedom.parse("all" if dof is None else dof).recentred(rows.origin)
    known = None if prior is None else prior_about(prior, rows.centre, rows.origin)
    if known is not None or goal in ("minimax", "outside", "inside"):
        near = _least_squares(rows, np.eye(4), free, None)[0]
        rows = rows.with_medians(near) if goal in ("minimax", "outside", "inside") else rows
        rows = rows.weighed_by_noise(near) if known is not None and goal != "minimax" else rows
    T, converged = _solved(rows, goal, free, known)
    _require_held(rows, T, free, known)
    values, _ = rows.deviations(T)
    bands = bool(np.isfinite(rows.low).all() and np.isfinite(rows.high).all())
    within = (values >= rows.low) & (values <= rows.high)
    shift = pose.from_parts(np.eye(3), rows.origin)
    information = None if known is None else known.information(T, rows.centre)
    found = SurfaceAlignment(
        T_target_source=shift @ T @ pose.inverse(shift),
        covariance=covariance_of(rows, T, goal, free, information),
        centre=rows.centre + rows.origin,
        goal=goal,
        points=len(values),
        rms=float(np.sqrt(np.mean(values**2))),
        largest=float(np.abs(values).max()),
        share_within=float(within.mean()) if bands else None,
        converged=converged,
    )
    return found if free.count == 6 else with_kept(found, rows.kept(T, free, information))


def _solved(rows: SurfaceRows, goal: Goal, free: Freedom, prior: PoseCost | None) -> tuple[FloatArray, bool]:
    if goal == "minimax":
        return _least_largest(rows, free, prior)
    T, converged = _least_squares(rows, np.eye(4), free, prior)
    if goal == "tolerance":
        return _most_within(rows, T, free, prior)
    if goal in ("outside", "inside"):
        return _one_sided(rows, T, free, prior, 1.0 if goal == "outside" else -1.0)
    return T, converged


def _least_squares(rows: SurfaceRows, T: FloatArray, free: Freedom, prior: PoseCost | None) -> tuple[FloatArray, bool]:
    for _ in range(MAX_STEPS):
        cost = rows.cost(T)
        moved = (cost if prior is None else cost + prior).minimise(near=T, dof=free, reference=np.eye(4))
        step = rows.length_of(moved.T_target_source, T)
        T = moved.T_target_source
        if step < CONVERGED_STEP:
            return T, True
    return T, False


def _most_within(rows: SurfaceRows, T: FloatArray, free: Freedom, prior: PoseCost | None) -> tuple[FloatArray, bool]:
    """Graduated: outliers of the bands lose their pull as the width shrinks; the pose with the most within is kept."""
    best, most = T, rows.within(T)
    narrowest = MIN_WIDTH_BANDS * float((rows.high - rows.low).min())
    width, still = max(float(np.abs(rows.deviations(T)[0]).max()), narrowest), False
    while True:
        T, still = _steps(rows, T, free, prior, width)
        # What is within is centred: of poses with as many within that is the one with the most room.
        centred, _ = _steps(rows, T, free, prior, 0.0)
        for pose_here in (T, centred):
            if rows.within(pose_here) >= most:
                best, most = pose_here, rows.within(pose_here)
        if width <= narrowest:
            return best, still
        width = max(WIDTH_SHRINK_FACTOR * width, narrowest)


def _steps(
    rows: SurfaceRows, T: FloatArray, free: Freedom, prior: PoseCost | None, width: float
) -> tuple[FloatArray, bool]:
    faint = CENTRING_COST_RATIO * (0.5 * float((rows.high - rows.low).min())) ** 2
    for _ in range(STEPS_PER_WIDTH):
        # A faint pull to the middle holds what the bands leave open.
        cost = rows.band_cost(T, width) + faint * rows.middle_cost(T) if width else rows.middle_cost(T)
        moved = (cost if prior is None else cost + prior).minimise(near=T, dof=free, reference=np.eye(4))
        step = rows.length_of(moved.T_target_source, T)
        T = moved.T_target_source
        if step < SETTLED_STEP:
            break
    return T, step < math.sqrt(SETTLED_STEP)


def _least_largest(rows: SurfaceRows, free: Freedom, prior: PoseCost | None) -> tuple[FloatArray, bool]:
    T, longest = _least_squares(rows, np.eye(4), free, prior)[0], MAX_STEP_DIAGONALS
    height = rows.height(T)
    for _ in range(MAX_STEPS):
        step = minimax_step(rows, T, free, prior, longest)
        moved = rows.stepped(T, step, free)
        new = rows.height(moved)
        if new < height and _allowed(prior, moved):
            gained, T, height = height - new, moved, new
            longest = min(2.0 * longest, MAX_STEP_DIAGONALS)
            if gained < CONVERGED_GAIN_DIAGONALS * rows.size:
                return T, True
        else:
            longest *= STEP_SHRINK_FACTOR
            if longest < CONVERGED_GAIN_DIAGONALS:
                return T, True
    return T, False


def _allowed(prior: PoseCost | None, T: FloatArray) -> bool:
    # Linear bounds of the step hold to first order; six values at their bound each give that.
    return prior is None or prior.value(T) <= 6.0 * PRIOR_SIGMAS**2 * (1.0 + 1e-6)


def _one_sided(
    rows: SurfaceRows, T: FloatArray, free: Freedom, prior: PoseCost | None, sign: float
) -> tuple[FloatArray, bool]:
    for _ in range(MAX_STEPS):
        step = one_sided_step(rows, T, free, prior, sign)
        if step is None:
            side, other = ("outside", "inside") if sign > 0.0 else ("inside", "outside")
            short = one_sided_excess(rows, T, free, sign)
            raise DegenerateGeometryError(
                f"no pose has the whole scan {side} of the part: at best a place lies {short:.4g} {other} of its "
                "limit; give the faces a band, or free a motion"
            )
        moved = rows.stepped(T, step, free)
        length = rows.length_of(moved, T)
        T = moved
        if length < CONVERGED_STEP:
            return T, True
    return T, length < math.sqrt(CONVERGED_STEP)


def _require_held(rows: SurfaceRows, T: FloatArray, free: Freedom, prior: PoseCost | None) -> None:
    cost = rows.cost(T)
    found = (cost if prior is None else cost + prior).minimise(near=T, dof=free, reference=np.eye(4))
    if found.free:
        raise DegenerateGeometryError(
            f"the chosen faces leave {', '.join(found.free)}; choose more faces, lock that motion, or give a prior"
        )
