"""Time of the solvers, beside the time of reading the same arrays once: ``pytest tests/bench --benchmark-only``.

Ratios are to NumPy sums of the same arrays, taken in turns with the solver, so that machines compare. They inform, they
never gate: nothing is asserted on a time.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

from dqreg.solvers import horn, moments_of, solve, solve_many, solve_moments, svd, walker1991

MILLION = 1_000_000
# A turn of 0.3 rad about z and a shift; the noise is a hundredth of the clouds' size.
T = np.array(
    [[np.cos(0.3), -np.sin(0.3), 0, 1], [np.sin(0.3), np.cos(0.3), 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], dtype=float
)


def pairs(count: int, noise: float = 0.01, away: float = 0.0) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    p, m = rng.normal(size=(count, 3)), rng.normal(size=(count, 3))
    m /= np.linalg.norm(m, axis=1, keepdims=True)
    q = p @ T[:3, :3].T + T[:3, 3] + noise * rng.normal(size=p.shape)
    return [p + away, q + away, m, m @ T[:3, :3].T]


def report(benchmark, capsys, **figures: float) -> None:
    benchmark.extra_info.update(figures)
    with capsys.disabled():
        words = ", ".join(f"{name} {value:,.2f}" for name, value in figures.items())
        print(f"\n{benchmark.name}: {words}")  # noqa: T201


def reading_time(arrays: list[np.ndarray]) -> float:
    """Time of one sum over each array, in seconds."""
    start = time.perf_counter()
    sum(array.sum() for array in arrays)
    return time.perf_counter() - start


CASES = {
    "points and directions": {},
    "points": {"directions": False},
    "far from the origin": {"away": 1e6},
    "weighted": {"weighted": True},
    "exact, so residuals too": {"noise": 0.0},
}


@pytest.mark.parametrize("case", CASES)
def test_solve_a_million_pairs(benchmark, capsys, case):
    options = CASES[case]
    arrays = pairs(MILLION, options.get("noise", 0.01), options.get("away", 0.0))
    arrays = arrays if options.get("directions", True) else arrays[:2]
    if options.get("weighted"):
        arrays += [np.random.default_rng(1).uniform(0.1, 1, MILLION) for _ in range(2)]
    readings: list[float] = []
    benchmark.pedantic(solve, args=arrays, setup=lambda: readings.append(reading_time(arrays)), rounds=30)
    best, reading = benchmark.stats["min"], min(readings)
    report(benchmark, capsys, ms=1e3 * best, reading_ms=1e3 * reading, times_reading=best / reading)


@pytest.mark.parametrize("count", [6, 100, 2000, 20_000])
def test_one_pose_from_checked_arrays(benchmark, capsys, count):
    p, q, *_ = pairs(count)
    benchmark(lambda: solve_moments(moments_of(p, q)))
    report(benchmark, capsys, microseconds=1e6 * benchmark.stats["min"])


@pytest.mark.parametrize("solver", [solve, svd, horn, walker1991])
def test_yardsticks_on_a_thousand_pairs(benchmark, capsys, solver):
    arrays = pairs(1000)
    benchmark(solver, *arrays)
    report(benchmark, capsys, microseconds=1e6 * benchmark.stats["min"])


@pytest.mark.parametrize("layout", ["equal", "ragged"])
def test_solve_many_of_six_pairs(benchmark, capsys, layout):
    count = 100_000
    p, q, *_ = pairs(6 * count)
    if layout == "equal":
        benchmark.pedantic(solve_many, args=(p.reshape(-1, 6, 3), q.reshape(-1, 6, 3)), rounds=5, warmup_rounds=1)
    else:
        # The same rows in problems of five to seven.
        edges = 6 * np.arange(count + 1) + np.tile([0, -1, 1, 0], count // 4 + 1)[: count + 1]
        edges[-1] = 6 * count
        benchmark.pedantic(solve_many, args=(p, q), kwargs={"offsets": edges}, rounds=5, warmup_rounds=1)
    report(benchmark, capsys, problems_a_second=count / benchmark.stats["min"])
