"""Far away and nearly degenerate: how exact four closed forms are without any noise.

In the spirit of D. W. Eggert, A. Lorusso and R. B. Fisher, "Estimating 3-D rigid body transformations: a comparison
of four major algorithms", Machine Vision and Applications 9 (1997).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.papers.document import Section
from dqreg.papers.trials import rotation_errors
from dqreg.report.table import Cell, Column, Table, short_number
from dqreg.rigid import pose
from dqreg.solvers import Fit, horn, solve, svd, walker1991

METHODS: dict[str, Callable[[FloatArray, FloatArray], Fit]] = {
    "solve": solve,
    "walker1991": walker1991,
    "svd": svd,
    "horn": horn,
}
POINTS = 20
DISTANCES = {
    "at the origin": 0.0,
    "1,000 sizes away": 1e3,
    "a million sizes away": 1e6,
    "a billion sizes away": 1e9,
}
WIDTHS = (1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 1e-9, 0.0)
SIZES = (1e-12, 1e12)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """One layout of points."""

    layout: str  # What was tried
    floor_rad: float  # What the rounding of the coordinates alone can do to the rotation, in order of magnitude
    worst_rad: dict[str, float]  # By method: largest rotation error of the trials that gave a pose; NaN if none did
    refused: dict[str, int]  # By method: trials that ended in `DegenerateGeometryError`
    trials: int  # Trials in all


def measure_accuracy(rng: np.random.Generator, trials: int = 50) -> tuple[Outcome, ...]:
    """Solve exact matches in hard layouts."""
    eps = float(np.finfo(np.float64).eps)
    outcomes = [_try(rng, name, trials, eps * max(d, 1.0), away=d) for name, d in DISTANCES.items()]
    for width in WIDTHS:
        name = f"on a line, width {short_number(width)} of the length" if width else "exactly on a line"
        floor = eps / width if width else np.inf
        outcomes.append(_try(rng, name, trials, floor, stretch=(1.0, width, width)))
    outcomes.append(_try(rng, "in a plane", trials, eps, stretch=(1.0, 1.0, 0.0)))
    outcomes += [_try(rng, f"size {short_number(size)}", trials, eps, stretch=(size, size, size)) for size in SIZES]
    outcomes.append(_try(rng, "one point, repeated", trials, np.inf, stretch=(0.0, 0.0, 0.0), away=1.0))
    return tuple(outcomes)


def _try(
    rng: np.random.Generator,
    layout: str,
    trials: int,
    floor_rad: float,
    stretch: tuple[float, float, float] = (1.0, 1.0, 1.0),
    away: float = 0.0,
) -> Outcome:
    worst = dict.fromkeys(METHODS, np.nan)
    refused = dict.fromkeys(METHODS, 0)
    for _ in range(trials):
        source, target, T = _layout(rng, stretch, away)
        for name, method in METHODS.items():
            try:
                error = float(rotation_errors(method(source, target).T_target_source, T))
            except DegenerateGeometryError:
                refused[name] += 1
            else:
                worst[name] = float(np.fmax(worst[name], error))
    return Outcome(layout, floor_rad, worst, refused, trials)


def _layout(
    rng: np.random.Generator, stretch: tuple[float, float, float], away: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    # Shape and turn are exact up to rounding; only then do both sides go far away, each its own way.
    shape = rng.uniform(-0.5, 0.5, size=(POINTS, 3)) * stretch
    T_shape, T = pose.random(rng), pose.random(rng)
    part = shape @ T_shape[:3, :3].T
    there, here = away * np.array([pose.random(rng)[:3, 0], pose.random(rng)[:3, 0]])
    return part + there, part @ T[:3, :3].T + here, T


def accuracy_section(outcomes: tuple[Outcome, ...]) -> Section:
    """Words and table of the measurement."""
    by_layout = {outcome.layout: outcome for outcome in outcomes}
    far = by_layout["a million sizes away"]
    table = Table(
        "accuracy",
        "Largest rotation error without noise",
        (Column("layout"), Column("rounding of the input", "rad", ".1e"), *(Column(n, "rad", ".1e") for n in METHODS)),
        tuple(
            (
                outcome.layout,
                outcome.floor_rad if np.isfinite(outcome.floor_rad) else None,
                *(_cell(outcome, name) for name in METHODS),
            )
            for outcome in outcomes
        ),
        "'refused': raised DegenerateGeometryError, which is the right outcome where the rotation is free or its "
        "digits are lost. Rounding of the input: order of magnitude of what float64 coordinates leave to any method.",
    )
    return Section(
        "accuracy",
        "Far origins and nearly degenerate parts",
        f"Near the origin all four are exact to rounding. A million sizes away solve errs by "
        f"{short_number(far.worst_rad['solve'], '.0e')} rad, as little as the rounding of the coordinates allows; "
        f"the algorithm as printed, which does not centre its points, {_far_words(far)}. Points on a line and repeated "
        "points are refused by all, never answered with a wrong pose.",
        (
            f"{POINTS} points of size 1, largest error of {outcomes[0].trials} random parts and turns, in the spirit "
            "of Eggert, Lorusso and Fisher (1997). Source and target go equally far away, each its own way.",
            "On thin strips all four lose twice the digits that the data lose: they work on sums of products of "
            "coordinates, whose rounding reaches the rotation as eps / width^2 and not as eps / width. Below a width "
            "of about 1e-6 nothing would be left, and they refuse.",
        ),
        (table,),
    )


def _far_words(outcome: Outcome) -> str:
    if outcome.refused["walker1991"] == outcome.trials:
        return "has lost its digits and is refused"
    return f"errs by {short_number(outcome.worst_rad['walker1991'], '.0e')} rad"


def _cell(outcome: Outcome, name: str) -> Cell:
    refused = outcome.refused[name]
    if not refused:
        return outcome.worst_rad[name]
    if refused == outcome.trials:
        return "refused"
    return f"{short_number(outcome.worst_rad[name], '.1e')}; {refused} of {outcome.trials} refused"
