"""Walker's Fig. 4 again: solution time against the number of samples."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.papers.document import Curve, Figure, Panel, Section, floats
from dqreg.papers.printed import WALKER
from dqreg.papers.trials import paper_pose
from dqreg.report.table import Column, Table
from dqreg.rigid import pose
from dqreg.solvers import solve, walker1991

METHODS: dict[str, Callable[..., object]] = {"solve": solve, "walker1991": walker1991}
# Half of the samples are points, half are directions, as in the paper; the first case is three points, the fewest.
FEWEST: int = WALKER["figure4"]["fewest_samples"]
SAMPLE_COUNTS = (FEWEST, 10, 20, 50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000)
PRINTED_SECONDS_PER_SAMPLE: float = WALKER["figure4"]["seconds_per_sample"]
# Squared correlation above which times are called linear in the number of samples.
LINEAR_R_SQUARED = 0.95


@dataclass(frozen=True, slots=True)
class Timing:
    """Solution times of one method."""

    method: str  # Name of the solver
    samples: tuple[int, ...]  # Points plus directions
    seconds: tuple[float, ...]  # Best time of several calls
    slope: float  # Seconds a sample, of the straight line with the least relative errors
    start: float  # Seconds at no samples, of the same line
    r_squared: float  # Squared correlation of the times with the numbers of samples: 1 on a straight line


def measure_time(rng: np.random.Generator, most: int = SAMPLE_COUNTS[-1], repeats: int = 9) -> tuple[Timing, ...]:
    """Time both solvers on points and directions."""
    counts = tuple(count for count in SAMPLE_COUNTS if count <= most)
    seconds: dict[str, list[float]] = {name: [] for name in METHODS}
    for count in counts:
        problem = _problem(rng, count) if count == FEWEST else _problem(rng, count // 2, count // 2)
        for name, method in METHODS.items():
            seconds[name].append(min(_duration(method, problem) for _ in range(repeats)))
    return tuple(_timing(name, counts, times) for name, times in seconds.items())


def _problem(rng: np.random.Generator, count: int, directions: int = 0) -> tuple[FloatArray, ...]:
    T = paper_pose()
    points = rng.normal(size=(count, 3))
    matches = (points, pose.apply(T, points) + rng.normal(scale=0.01, size=points.shape))
    if not directions:
        return matches
    m = rng.normal(size=(directions, 3))
    m /= np.linalg.norm(m, axis=1, keepdims=True)
    return (*matches, m, pose.rotate(T, m))


def _duration(method: Callable[..., object], problem: tuple[FloatArray, ...]) -> float:
    began = time.perf_counter()
    method(*problem)
    return time.perf_counter() - began


def _timing(name: str, counts: tuple[int, ...], seconds: list[float]) -> Timing:
    n, t = np.array(counts, dtype=np.float64), np.array(seconds)
    # Relative errors: the plain least squares see the largest numbers only, and can start below zero.
    slope, start = np.polyfit(n, t, 1, w=1.0 / t)
    r_squared = float(np.corrcoef(n, t)[0, 1] ** 2)
    return Timing(name, counts, floats(seconds), float(slope), float(start), r_squared)


def time_section(timings: tuple[Timing, ...]) -> Section:
    """Words, tables and figure of the measurement."""
    lines = Table(
        "slopes",
        "Straight line through the times",
        (
            Column("whose"),
            Column("slope", "µs/sample", ".5g"),
            Column("start", "µs", ".0f"),
            Column("R squared", spec=".5f"),
        ),
        (
            ("paper: Compaq 386/20 with 80387", 1e6 * PRINTED_SECONDS_PER_SAMPLE, None, None),
            *((f"ours: {t.method}", 1e6 * t.slope, 1e6 * t.start, t.r_squared) for t in timings),
        ),
        "One sample is one point or one direction. Slope and start: least relative errors. R squared: of times and "
        "samples. The paper gives about 1.0 ms a sample and no fit.",
    )
    times = Table(
        "times",
        "Solution time, best of several calls",
        (Column("samples"), *(Column(t.method, "µs", ".0f") for t in timings)),
        tuple((count, *(1e6 * t.seconds[i] for t in timings)) for i, count in enumerate(timings[0].samples)),
    )
    return Section(
        "time",
        "Figure 4: solution time",
        _finding(min(timings, key=lambda t: t.slope)),
        (
            f"Half of the samples are points, half are directions, as in the paper; the first case is {FEWEST} points. "
            "A call includes the input checks.",
        ),
        (lines, times),
        (_figure(timings),),
    )


def _finding(fastest: Timing) -> str:
    measured = f"R squared {fastest.r_squared:.3f} over {fastest.samples[0]:,} to {fastest.samples[-1]:,} samples"
    if fastest.r_squared >= LINEAR_R_SQUARED and fastest.slope > 0.0:
        return (
            f"The time is close to a fixed cost plus a constant for each sample, as the paper says (O(n)): "
            f"{fastest.method} takes {1e6 * fastest.start:.0f} µs and {1e9 * fastest.slope:.0f} ns a sample on this "
            f"machine ({measured}), the paper's took {1e3 * PRINTED_SECONDS_PER_SAMPLE:g} ms a sample."
        )
    return (
        f"These times do not show the line that the paper reports (O(n)): {measured}. With few samples the fixed cost "
        "of a call hides it; a run without --quick goes to more."
    )


def _figure(timings: tuple[Timing, ...]) -> Figure:
    curves = []
    for colour, t in enumerate(timings):
        x = floats(t.samples)
        curves.append(
            Curve(t.method, x, floats(1e3 * s for s in t.seconds), colour=colour, line="", marker="os"[colour])
        )
        curves.append(Curve("", x, floats(1e3 * (t.start + t.slope * n) for n in x), colour=colour))
    curves.append(
        Curve("paper: 1.0 ms/sample", x, floats(1e3 * PRINTED_SECONDS_PER_SAMPLE * n for n in x), colour=6, line="--")
    )
    panel = Panel("samples (points + directions)", "solution time [ms]", tuple(curves), log_x=True, log_y=True)
    return Figure(
        "time",
        "Solution time against the number of samples",
        (panel,),
        "Full lines: straight-line fits, bent by the logarithmic axes. For few samples the fixed cost of a call "
        "dominates.",
    )
