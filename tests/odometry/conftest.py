"""A virtual LiDAR in a furnished hall: frames with known poses, and the times of their points."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.rigid import pose, twist
from dqreg.synth.parts import box
from dqreg.synth.raycast import first_hits

SIGMA = 0.01


@dataclasses.dataclass(frozen=True)
class Sequence:
    frames: list[FloatArray]
    truth: FloatArray  # T_world_sensor at the end of each sweep
    times: list[FloatArray] | None = None


def hall() -> tuple[FloatArray, FloatArray]:
    # Size and place of a hall of 16 x 12 x 5 units, and of what stands in it.
    pieces = [
        ((16, 12, 5), (0, 0, 1.5)),
        ((1, 2, 2), (-5, -3, 0)),
        ((2, 1, 3), (4, 3, 0.5)),
        ((1, 1, 5), (1.5, -4, 1.5)),
        ((3, 0.6, 1), (-3, 4.5, -0.5)),
        ((0.8, 0.8, 1.6), (6, -2, -0.2)),
    ]
    vertices, faces, count = [], [], 0
    for size, place in pieces:
        v, f = box(size=size)
        vertices.append(v + place)
        faces.append(f + count)
        count += len(v)
    return np.vstack(vertices), np.vstack(faces)


def sweep(world, T_start, T_end, rng, columns=300, rings=24):
    # A turning head: the columns of a sweep are fired one after the other, while the sensor moves.
    azimuth = np.repeat(np.linspace(0, 2 * np.pi, columns, endpoint=False), rings)
    elevation = np.tile(np.deg2rad(np.linspace(-25, 25, rings)), columns)
    rays = np.column_stack(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
    )
    times = azimuth / azimuth.max()
    step = twist.log(pose.inverse(T_start) @ T_end)
    T = T_start @ twist.exp(times[:, None] * step)
    directions = np.einsum("nij,nj->ni", T[:, :3, :3], rays)
    _, hits = first_hits(*world, T[:, :3, 3].copy(), directions)
    ranges = np.einsum("ij,ij->i", hits - T[:, :3, 3], directions) + rng.normal(0, SIGMA, len(rays))
    return rays * ranges[:, None], times


def path(steps: int, turn_deg: float, *, moving: bool, rests: bool = True) -> FloatArray:
    T = [pose.from_parts(np.eye(3), [-2.0, 0.0, 0.0])]
    for i in range(steps):
        if moving:
            # At rest at first, so that the map begins straight; then a bend whose sense changes half way: where it
            # does, the last motion is the wrong one to undo.
            yaw = np.deg2rad(turn_deg if i <= steps // 2 else -turn_deg)
            T.append(T[-1] @ twist.exp((i > 0 or not rests) * np.array([0.0, 0.0, yaw, 0.3, 0.0, 0.0])))
            continue
        # Turns that change their sign make constant velocity wrong by twice the turn.
        yaw = np.deg2rad(turn_deg) * np.cos(1.3 * i)
        T.append(T[-1] @ twist.exp([0.02 * np.sin(i), 0.02 * np.cos(2 * i), yaw, 0.25, 0.05 * np.sin(i), 0.01]))
    return np.stack(T)


def record(turn_deg: float, count: int, *, moving: bool, rests: bool = True, seed: int = 0) -> Sequence:
    world, rng = hall(), np.random.default_rng(seed)
    T = path(count, turn_deg, moving=moving, rests=rests)
    swept = [sweep(world, T[i] if moving else T[i + 1], T[i + 1], rng) for i in range(count)]
    return Sequence([points for points, _ in swept], T[1:], [times for _, times in swept])


@pytest.fixture(scope="session")
def jerky() -> Sequence:
    """Still while it looks; turns of up to 38 degrees between frames."""
    return record(38.0, 10, moving=False)


@pytest.fixture(scope="session")
def smooth() -> Sequence:
    """Moving while it looks: a bend to the left, then one to the right."""
    return record(5.0, 8, moving=True, seed=1)


@pytest.fixture(scope="session")
def moving() -> Sequence:
    """The same, but under way at the first frame already."""
    return record(5.0, 8, moving=True, rests=False, seed=1)
