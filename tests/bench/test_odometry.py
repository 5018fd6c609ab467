"""A drive through a simulated street beside KISS-ICP: ``pytest tests/bench/test_odometry.py --benchmark-only``.

Truth: the poses that the rays were cast from, column after column while the sensor moves. Both are given the times of
the points. The figures inform, they never gate on a time; what is asserted is the error.
"""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.odometry import Odometry, evaluate
from dqreg.rigid import pose, twist
from dqreg.synth.raycast import first_hits
from dqreg.synth.street import street
from tests.bench.test_clouds import in_turns
from tests.bench.test_solve import report
from tests.strategies import FloatArray

# Metres and seconds: 10 Hz at 8 m/s, bends of 3 degrees a sweep.
FRAMES, RINGS, COLUMNS, REACH, SIGMA = 20, 48, 1200, 80.0, 0.02
ROUNDS = 2


def drive(rng: np.random.Generator) -> tuple[list[FloatArray], list[FloatArray], FloatArray]:
    """Sweeps, the times of their points, and the poses at their ends."""
    scene = street(rng)
    elevation, turn = np.meshgrid(
        np.deg2rad(np.linspace(-24.8, 2, RINGS)), np.arange(COLUMNS) * -2 * np.pi / COLUMNS, indexing="ij"
    )
    rays = np.stack([np.cos(elevation) * np.cos(turn), np.cos(elevation) * np.sin(turn), np.sin(elevation)], axis=-1)
    rays, times = rays.reshape(-1, 3), np.tile(np.arange(COLUMNS) / COLUMNS, RINGS)
    T, frames, stamps, truth = pose.from_parts(np.eye(3), [-12.0, 0.0, 1.75]), [], [], []
    for k in range(FRAMES):
        yaw = np.deg2rad(3.0) * np.sin(0.3 * k)
        step = np.array([0.002 * np.sin(0.5 * k), 0.003 * np.cos(0.4 * k), yaw, 0.8 + 0.2 * np.sin(0.2 * k), 0.0, 0.0])
        along = T @ twist.exp(times[:, None] * step)
        T = T @ twist.exp(step)
        directions = np.einsum("nij,nj->ni", along[:, :3, :3], rays)
        _, hits = first_hits(*scene, along[:, :3, 3].copy(), directions)
        ranges = np.linalg.norm(hits - along[:, :3, 3], axis=1)
        seen = ranges < REACH
        noisy = ranges[seen] + SIGMA * rng.normal(size=int(seen.sum()))
        frames.append(rays[seen] * noisy[:, None])
        stamps.append(times[seen])
        truth.append(T)
    return frames, stamps, np.stack(truth)


def test_a_drive_under_way_beside_kiss_icp(benchmark, capsys) -> None:
    pytest.importorskip("kiss_icp")
    from dqreg.odometry.peers import KissEngine

    frames, stamps, truth = drive(np.random.default_rng(0))

    def ours() -> FloatArray:
        odometry = Odometry()
        for points, times in zip(frames, stamps, strict=True):
            assert odometry.register_frame(points, times).verdict.level == "accepted"
        return odometry.poses

    def kiss() -> FloatArray:
        engine = KissEngine()
        return np.stack([engine.place(points, times) for points, times in zip(frames, stamps, strict=True)])

    runs = {"ours": ours, "kiss": kiss}
    off = {name: evaluate(run(), truth).steps for name, run in runs.items()}
    spent = in_turns(runs, ROUNDS)
    wall, cpu = np.median(spent["ours"] / spent["kiss"], axis=0)
    errors = {f"{name}_{k}_mm": 1e3 * float(np.median(off[name][k][1])) for name in runs for k in (1, 10)}
    benchmark.pedantic(ours, rounds=1)
    report(benchmark, capsys, times_kiss_wall=float(wall), times_kiss_cpu=float(cpu), **errors)
    # Three times what this drive gave; and the share of KISS-ICP's error that is asked for.
    assert errors["ours_1_mm"] < 15.0
    for k in (1, 10):
        assert errors[f"ours_{k}_mm"] < 0.3 * errors[f"kiss_{k}_mm"]
