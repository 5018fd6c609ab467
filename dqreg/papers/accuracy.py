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
POINT_COUNT = 20
# Errors of a rotation are some ten roundings of a coordinate; this many are none of the input's.
NEAR_FLOOR = 100.0
DISTANCES = {
    "at the origin": 0.0,
    "1,000 sizes away": 1e3,
    "a million sizes away": 1e6,
    "a billion sizes away": 1e9,
}
STRIP_WIDTHS = (1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 1e-9, 0.0)
PART_SIZES = (1e-12, 1e12)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """One layout of points."""

    layout: str  # What was tried
    aligned: bool  # Whether the source lies along the axes, as a CAD part does, or anyhow
    floor_rad: float  # What the rounding of the coordinates alone can do to the rotation, in order of magnitude
    worst_rad: dict[str, float]  # By method: largest rotation error of the trials that gave a pose; NaN if none did
    refused: dict[str, int]  # By method: trials that ended in `DegenerateGeometryError`
    trials: int  # Trials in all


def measure_accuracy(rng: np.random.Generator, trials: int = 50) -> tuple[Outcome, ...]:
    """Solve exact matches in hard layouts."""
    eps = float(np.finfo(np.float64).eps)
    outcomes = [_try(rng, name, trials, eps * max(d, 1.0), away=d) for name, d in DISTANCES.items()]
    for aligned in (True, False):
        for width in STRIP_WIDTHS:
            name = (
                f"{_place(aligned)}, {f'width {short_number(width)} of the length' if width else 'exactly on a line'}"
            )
            floor = eps / width if width else np.inf
            outcomes.append(_try(rng, name, trials, floor, stretch=(1.0, width, width), aligned=aligned))
    outcomes.append(_try(rng, "in a plane", trials, eps, stretch=(1.0, 1.0, 0.0)))
    names = {f"size {short_number(size)}": (size, size, size) for size in PART_SIZES}
    outcomes += [_try(rng, name, trials, eps, stretch=stretch) for name, stretch in names.items()]
    outcomes.append(_try(rng, "one point, repeated", trials, np.inf, stretch=(0.0, 0.0, 0.0), away=1.0))
    return tuple(outcomes)


def _try(
    rng: np.random.Generator,
    layout: str,
    trials: int,
    floor_rad: float,
    stretch: tuple[float, float, float] = (1.0, 1.0, 1.0),
    away: float = 0.0,
    aligned: bool = False,
) -> Outcome:
    worst = dict.fromkeys(METHODS, np.nan)
    refused = dict.fromkeys(METHODS, 0)
    for _ in range(trials):
        source, target, T = _layout(rng, stretch, away, aligned)
        for name, method in METHODS.items():
            try:
                error = float(rotation_errors(method(source, target).T_target_source, T))
            except DegenerateGeometryError:
                refused[name] += 1
            else:
                worst[name] = float(np.fmax(worst[name], error))
    return Outcome(layout, aligned, floor_rad, worst, refused, trials)


def _layout(
    rng: np.random.Generator, stretch: tuple[float, float, float], away: float, aligned: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    # Shape and turn are exact up to rounding; only then do both sides go far away, each its own way.
    shape = rng.uniform(-0.5, 0.5, size=(POINT_COUNT, 3)) * stretch
    T_shape, T = pose.random(rng), pose.random(rng)
    part = shape if aligned else shape @ T_shape[:3, :3].T
    there, here = away * np.array([pose.random(rng)[:3, 0], pose.random(rng)[:3, 0]])
    return part + there, part @ T[:3, :3].T + here, T


def accuracy_section(outcomes: tuple[Outcome, ...]) -> Section:
    """Words and table of the measurement."""
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
        _finding(outcomes),
        (
            f"{POINT_COUNT} points of size 1, largest error of {outcomes[0].trials} random parts and turns, in the "
            "spirit of Eggert, Lorusso and Fisher (1997). Source and target go equally far away, each its own way. "
            "Strips lie along the axes, as CAD parts do, or in general position.",
            _narrow_words(outcomes),
        ),
        (table,),
    )


def _place(aligned: bool) -> str:
    return "strip along the axes" if aligned else "strip in general position"


def _finding(outcomes: tuple[Outcome, ...]) -> str:
    by_layout = {outcome.layout: outcome for outcome in outcomes}
    near, far = by_layout["at the origin"], by_layout["a million sizes away"]
    lost = [name for name in METHODS if not near.worst_rad[name] <= NEAR_FLOOR * near.floor_rad]
    words = ["Near the origin all four are exact to rounding."]
    if lost:
        most = max(near.worst_rad[name] for name in lost)
        words = [f"Near the origin {', '.join(lost)} err by up to {most:.0e} rad, more than rounding."]
    words += [f"A million sizes away {name} {_far_words(far, name)}." for name in ("solve", "walker1991")]
    free = [outcome for outcome in outcomes if not np.isfinite(outcome.floor_rad)]
    wrong = sorted({name for outcome in free for name, count in outcome.refused.items() if count < outcome.trials})
    words.append(
        f"Of points on a line and repeated points {', '.join(wrong)} give a pose, though their rotation is free."
        if wrong
        else "Points on a line and repeated points are refused by all, never answered with a wrong pose."
    )
    return " ".join(words)


def _far_words(outcome: Outcome, name: str) -> str:
    if outcome.refused[name] == outcome.trials:
        return "has lost its digits and is refused"
    error = f"errs by {short_number(outcome.worst_rad[name], '.0e')} rad"
    if outcome.worst_rad[name] <= NEAR_FLOOR * outcome.floor_rad:
        return f"{error}, as little as the rounding of the coordinates allows"
    return (
        f"{error}, {short_number(outcome.worst_rad[name] / outcome.floor_rad, '.0e')} times the rounding of the input"
    )


def _narrow_words(outcomes: tuple[Outcome, ...]) -> str:
    """Which methods keep the digits of narrow strips, and which lose them twice."""
    words = []
    for aligned in (True, False):
        strips = [o for o in outcomes if "strip" in o.layout and o.aligned is aligned and np.isfinite(o.floor_rad)]
        kept = {name: [_keeps(strip, name) for strip in strips] for name in METHODS}
        whole = [name for name, row in kept.items() if all(row)]
        part = {name: sum(row) for name, row in kept.items() if not all(row)}
        how = (
            f"the digits of the data are kept at every width by {', '.join(whole)}"
            if whole
            else "no method keeps them at every width"
        )
        rest = ", ".join(f"{name} at {count} of {len(strips)}" for name, count in part.items())
        words.append(f"{_place(aligned).capitalize()}: {how}{f'; {rest}' if rest else ''}.")
    return (
        f"Of a thin strip float64 coordinates leave eps over the width; a method keeps the digits if it errs by less "
        f"than {NEAR_FLOOR:g} times that and refuses nothing. Sums of products of coordinates alone leave eps over the "
        f"width squared. {' '.join(words)}"
    )


def _keeps(outcome: Outcome, name: str) -> bool:
    return not outcome.refused[name] and outcome.worst_rad[name] <= NEAR_FLOOR * outcome.floor_rad


def _cell(outcome: Outcome, name: str) -> Cell:
    refused = outcome.refused[name]
    if not refused:
        return outcome.worst_rad[name]
    if refused == outcome.trials:
        return "refused"
    return f"{short_number(outcome.worst_rad[name], '.1e')}; {refused} of {outcome.trials} refused"
