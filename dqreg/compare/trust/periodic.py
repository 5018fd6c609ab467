"""Parts that repeat themselves: the same shape one period on, and something that tells the periods apart or nothing."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.trust.shapes import relief
from dqreg.geometry import Mesh
from dqreg.rigid import pose


@dataclasses.dataclass(frozen=True, eq=False)
class Periodic:
    """A part with the motion by one period, in its own frame."""

    mesh: Mesh
    period: FloatArray  # (4, 4): Puts the part onto itself but for its ends
    middle: FloatArray  # (3,): Centre of the part
    cell: float  # Length of a period


def stairs(rng: np.random.Generator) -> Periodic:
    """Equal steps, and a block that carries them."""
    count, tread, rise = int(rng.integers(5, 12)), rng.uniform(6, 15), rng.uniform(4, 12)
    heights = rise * np.arange(1.0, count + 1.0) + rng.uniform(2, 10)
    x = tread * np.arange(count + 1.0)
    mesh = relief(x, np.array([0.0, rng.uniform(25, 80)]), heights[:, None])
    return Periodic(mesh, _shift([tread, 0.0, rise]), mesh.centre, float(np.hypot(tread, rise)))


def pegs(rng: np.random.Generator) -> Periodic:
    """A plate with a lattice of equal pegs."""
    columns, rows = (int(n) for n in rng.integers(5, 9, 2))
    pitch, width = rng.uniform(8, 16), rng.uniform(0.3, 0.6)
    floor, top = rng.uniform(3, 8), rng.uniform(10, 20)
    x, y = (np.sort(np.concatenate([pitch * k, pitch * (k + width), [-(1 - width) * pitch]]))
            for k in (np.arange(columns), np.arange(rows)))  # fmt: skip
    x, y = np.append(x, x[-1] + (1 - width) * pitch), np.append(y, y[-1] + (1 - width) * pitch)
    heights = np.full((len(x) - 1, len(y) - 1), floor)
    heights[1::2, 1::2] = top
    mesh = relief(x, y, heights)
    step = [pitch, 0.0, 0.0] if rng.uniform() < 0.5 else [0.0, pitch, 0.0]
    return Periodic(mesh, _shift(step), mesh.centre, pitch)


def rack(rng: np.random.Generator) -> Periodic:
    """A toothed rack."""
    count, pitch, width = int(rng.integers(7, 16)), rng.uniform(6, 12), rng.uniform(0.35, 0.6)
    x = np.sort(np.concatenate([pitch * np.arange(count), pitch * (np.arange(count) + width)]))
    heights = np.full((len(x) - 1, 1), rng.uniform(5, 12))
    heights[::2] += rng.uniform(0.5, 1.0) * pitch
    mesh = relief(x, np.array([0.0, rng.uniform(10, 40)]), heights)
    return Periodic(mesh, _shift([pitch, 0.0, 0.0]), mesh.centre, pitch)


def thread(rng: np.random.Generator) -> Periodic:
    """A threaded rod: one turn and one pitch on it is the same."""
    turns, pitch, radius = int(rng.integers(6, 12)), rng.uniform(4, 9), rng.uniform(12, 30)
    depth, around = rng.uniform(0.4, 0.7) * pitch, 64
    z = np.linspace(0.0, turns * pitch, turns * 12 + 1)
    angle = np.arange(around) * 2 * np.pi / around
    r = radius + depth * np.abs(2 * ((z[:, None] / pitch - angle / (2 * np.pi)) % 1.0) - 1.0)
    side = np.stack([r * np.cos(angle), r * np.sin(angle), np.broadcast_to(z[:, None], r.shape)], axis=-1)
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, z[-1]]])
    index = np.arange(side.shape[0] * around).reshape(-1, around)
    along = np.roll(index, -1, axis=1)
    low, high = index.size, index.size + 1
    a, b, c, d = index[:-1], along[:-1], along[1:], index[1:]
    faces = [
        np.stack([a, b, c], axis=-1).reshape(-1, 3),
        np.stack([a, c, d], axis=-1).reshape(-1, 3),
        np.stack([along[0], index[0], np.full(around, low)], axis=-1),
        np.stack([index[-1], along[-1], np.full(around, high)], axis=-1),
    ]
    mesh = Mesh(np.concatenate([side.reshape(-1, 3), ends]), np.concatenate(faces))
    screw = _shift([0.0, 0.0, 0.5 * pitch]) @ pose.from_parts(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    return Periodic(mesh, screw, mesh.centre, 0.5 * pitch)


def _shift(vector: list[float]) -> FloatArray:
    return pose.from_parts(np.eye(3), np.array(vector))
