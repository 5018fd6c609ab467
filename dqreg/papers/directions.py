"""What directions buy: few points, with more and more directions, exact ones and rough ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg.papers.document import Curve, Figure, Panel, Section
from dqreg.papers.printed import WALKER
from dqreg.papers.simulation import Accuracy, SetUp
from dqreg.papers.trials import SIGMA, exceeds
from dqreg.report.table import Column, Estimate, Table
from dqreg.solvers import likelihood_weights
from dqreg.synth.parts.blocks import FEEDER_DIAGONAL

POINT_COUNTS = (1, 3, 5)
DIRECTION_COUNTS = (0, 1, 2, 5, 10)
# Noise of a direction times the diagonal of the part over the noise of a point.
SIGMA_RATIOS = (0.1, 1.0, 10.0)
# The paper sets alpha = beta = 1, and its beta weighs a quarter of the squared distance (eq. 26).
# A rotation error that is none of the noise's.
LARGE_DEG = 10.0
PAPER_WEIGHTS: tuple[float, float] = (0.25 * WALKER["simulation"]["beta"], WALKER["simulation"]["alpha"])


@dataclass(frozen=True, slots=True)
class Gain:
    """One number of points and directions at one ratio of noise."""

    # points, directions: How many of each
    points: int
    directions: int
    ratio: float  # sigma_n * size / sigma_p
    # likely, equal: Errors with weights of maximum likelihood, and with alpha = beta = 1 as in the paper
    likely: Accuracy
    equal: Accuracy
    bound: tuple[float, float]  # Least possible errors: degrees, length


def measure_directions(rng: np.random.Generator, choices: int = 20, trials: int = 400) -> tuple[Gain, ...]:
    """Simulate all numbers of points and directions."""
    gains = []
    for points in POINT_COUNTS:
        full = SetUp.draw(rng, (points, max(DIRECTION_COUNTS)), choices, trials)
        for directions in DIRECTION_COUNTS:
            if points < 3 and directions < 2:
                continue  # the pose is free
            part = full.first_directions(directions)
            for ratio in SIGMA_RATIOS:
                sigmas = (SIGMA, ratio * SIGMA / FEEDER_DIAGONAL)
                weights = likelihood_weights(sigmas[0], sigmas[1] ** 2)
                likely = part.simulate(sigmas, (float(weights[0]), float(weights[1])))
                equal = part.simulate(sigmas, PAPER_WEIGHTS)
                gains.append(Gain(points, directions, ratio, likely, equal, part.predict(sigmas)))
    return tuple(gains)


Gains = dict[tuple[int, int, float], Gain]


def _finding(gains: Gains) -> str:
    bare, helped = (gains[3, m, 0.1].likely.turn_deg for m in (0, 2))
    equal = gains[3, 2, 0.1].equal.turn_deg
    words = ["Two very exact directions (ratio 0.1) beside three points, weighed by their likelihood, "]
    if exceeds(bare, helped):
        words.append(f"bring the rotation error from {bare.value:.3f} to {helped.value:.3f} degrees")
    else:
        words.append(
            f"do not help: the rotation error is {helped.value:.3f} degrees with them and {bare.value:.3f} without"
        )
    if exceeds(equal, helped):
        words.append(f"; with alpha = beta = 1 it is {equal.value:.3f}. ")
    else:
        words.append(f"; alpha = beta = 1 is as good ({equal.value:.3f}). ")
    lone = gains[1, 2, 0.1].likely.turn_deg.value
    enough = np.isfinite(lone) and lone < LARGE_DEG
    words.append(f"One point is {'' if enough else 'not '}enough where two directions are known.")
    return "".join(words)


def directions_section(gains: tuple[Gain, ...]) -> Section:
    """Words, tables and figure of the measurement."""
    by_key = {(gain.points, gain.directions, gain.ratio): gain for gain in gains}
    return Section(
        "directions",
        "What directions buy",
        _finding(by_key),
        (
            f"Noise of a point: {SIGMA:g} units on each coordinate. Ratio: noise of a direction (radians, along each "
            f"of the two ways across it) times the diagonal of the part ({FEEDER_DIAGONAL:.1f} units) over the noise "
            f"of a point; at ratio 1 a direction is off by {np.rad2deg(SIGMA / FEEDER_DIAGONAL):.3f} degrees. "
            "Directions are drawn evenly over the sphere, points among the vertices of the stand-in; sets of three "
            "and five that lie nearly on a line are drawn again. ML: alpha = 1 / sigma_n^2, beta = 1 / sigma_p^2. "
            "Equal: alpha = beta = 1, as in the paper, in its unit of length.",
        ),
        (_table(by_key, "turn"), _table(by_key, "shift")),
        (_figure(by_key),),
    )


def _table(gains: Gains, kind: str) -> Table:
    unit, title = ("deg", "Rotation error") if kind == "turn" else ("units", "Position error of the part's centre")
    heads = [Column(f"ratio {ratio:g}: {name}", unit) for ratio in SIGMA_RATIOS for name in ("ML", "equal", "bound")]
    rows = []
    for points, directions in dict.fromkeys((p, m) for p, m, _ in gains):
        cells: list[Estimate | float] = []
        for ratio in SIGMA_RATIOS:
            gain = gains[points, directions, ratio]
            if kind == "turn":
                cells += [gain.likely.turn_deg, gain.equal.turn_deg, gain.bound[0]]
            else:
                cells += [gain.likely.shift, gain.equal.shift, gain.bound[1]]
        rows.append((points, directions, *cells))
    return Table(
        f"directions_{kind}",
        f"{title}, root mean square",
        (Column("points"), Column("directions"), *heads),
        tuple(rows),
        "In brackets: one Monte-Carlo standard error, in units of the last digits. Bound: Cramer-Rao. The same draws "
        "serve all weights and ratios.",
    )


def _figure(gains: Gains) -> Figure:
    panels = []
    for points in POINT_COUNTS:
        curves = []
        for colour, ratio in enumerate(SIGMA_RATIOS):
            row = [gain for gain in gains.values() if gain.points == points and gain.ratio == ratio]
            for name, line, marker in (("likely", "-", "o"), ("equal", "--", "x")):
                found = [getattr(gain, name).turn_deg for gain in row]
                curves.append(
                    Curve(
                        f"{'ML' if name == 'likely' else 'equal'}, ratio {ratio:g}",
                        tuple(float(gain.directions) for gain in row),
                        tuple(estimate.value for estimate in found),
                        tuple(estimate.error for estimate in found),
                        colour,
                        line,
                        marker,
                    )
                )
        title = f"{points} point{'s' if points > 1 else ''}"
        panels.append(Panel("directions", "rotation error, rms [deg]", tuple(curves), title, log_y=True))
    return Figure(
        "directions",
        "Rotation error against the number of directions",
        tuple(panels),
        "Full lines: likelihood weights. Broken lines: alpha = beta = 1. Bars: one standard error.",
    )
