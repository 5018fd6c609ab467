"""Section 5 of Jia's notes: registration with known correspondences by Horn's quaternions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg.papers.document import Section
from dqreg.papers.trials import exceeds, position_errors, rms_estimate, rotation_errors
from dqreg.report.table import Column, Estimate, Table
from dqreg.rigid import pose
from dqreg.solvers import horn
from dqreg.solvers.cramer_rao import cramer_rao, rms_of

NOISE_SIGMAS = (0.0, 1e-4, 1e-3, 1e-2)
POINT_COUNT = 50
# Nearness to the bound, beside chance.
CLOSE_RATIO = 1.01


@dataclass(frozen=True, slots=True)
class HornRow:
    """Horn's method at one noise."""

    noise: float  # Standard deviation of a coordinate, over the size of the part
    # turn_rad, shift: Root mean square errors of the rotation and of the place of the mean point (over the size)
    turn_rad: Estimate
    shift: Estimate
    bound: tuple[float, float]  # Least possible errors of the same


def measure_registration(rng: np.random.Generator, trials: int = 2000) -> tuple[HornRow, ...]:
    """Run Horn on matched points with noise."""
    return tuple(_horn_row(rng, noise, trials) for noise in NOISE_SIGMAS)


def _horn_row(rng: np.random.Generator, noise: float, trials: int) -> HornRow:
    points, T_truth = rng.uniform(-0.5, 0.5, size=(POINT_COUNT, 3)) / np.sqrt(3.0), pose.random(rng, reach=1.0)
    exact = pose.apply(T_truth, points)
    measured = exact + rng.normal(scale=noise, size=(trials, *points.shape))
    T = np.array([horn(points, target).T_target_source for target in measured])
    mean = points.mean(axis=0)
    bound = (0.0, 0.0)
    if noise > 0.0:
        bound = rms_of(cramer_rao(exact, np.zeros((0, 3)), exact.mean(axis=0), noise, 1.0))
    turn = rms_estimate(rotation_errors(T, T_truth)[np.newaxis])
    return HornRow(noise, turn, rms_estimate(position_errors(T, T_truth, mean)[np.newaxis]), bound)


def registration_section(rows: tuple[HornRow, ...]) -> Section:
    """Words and table of the measurement."""
    noisy = [row for row in rows if row.noise > 0.0]
    pairs = [pair for row in noisy for pair in ((row.turn_rad, row.bound[0]), (row.shift, row.bound[1]))]
    worst = max(found.value / bound for found, bound in pairs)
    # Second-order terms of the largest noise are a few per mille.
    over = [found for found, bound in pairs if exceeds(found, Estimate(CLOSE_RATIO * bound, 0.0))]
    under = [found for found, bound in pairs if exceeds(Estimate(bound / CLOSE_RATIO, 0.0), found)]
    reach = f"its rms errors are at most {worst:.2f} times the Cramer-Rao bound"
    if over:
        finding = f"With known correspondences Horn's method is not as exact as the noise allows: {reach}."
    elif under:
        finding = f"{len(under)} errors lie below the Cramer-Rao bound: the bound or the simulation is wrong ({reach})."
    else:
        finding = f"With known correspondences Horn's method is as exact as the noise allows: {reach}."
    return Section(
        "registration",
        "Section 5: registration by Horn's quaternions",
        finding,
        (f"{POINT_COUNT} points in a cube with diagonal 1, any pose, noise on each coordinate of the target.",),
        (_table(rows),),
    )


def _table(rows: tuple[HornRow, ...]) -> Table:
    columns = (
        Column("noise / size"),
        Column("rotation rms", "rad"),
        Column("rotation bound", "rad"),
        Column("position rms / size"),
        Column("position bound / size"),
    )
    return Table(
        "horn",
        "Horn's method with known correspondences",
        columns,
        tuple((row.noise, row.turn_rad, row.bound[0], row.shift, row.bound[1]) for row in rows),
        "In brackets: one standard error, in units of the last digits. Position: of the mean of the points. Without "
        "noise the bound is zero and the error is rounding.",
    )
