"""A task of the trust sweep: what is registered, which poses are right, and the list of all kinds."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, PointCloud
from dqreg.rigid import pose
from dqreg.synth import disturbance, random_pose

NONE_RIGHT: FloatArray = np.zeros((0, 4, 4))


@dataclasses.dataclass(frozen=True, eq=False)
class Walls:
    """Thin walls of a part, whose sides are nearer to each other than a pose may be off elsewhere."""

    points: FloatArray  # (n, 3): Places on them, target frame
    normals: FloatArray  # (n, 3)
    thickness: float


@dataclasses.dataclass(frozen=True, eq=False)
class TrustTask:
    """One registration."""

    source: FloatArray  # (n, 3)
    target: Mesh | PointCloud
    start: FloatArray | str | None
    truths: FloatArray  # (k, 4, 4): right poses; none where nothing may be accepted
    probes: FloatArray  # (v, 3): points of the part, target frame, whose displacement decides what is right
    size: float
    noise: float  # Standard deviation of the scan
    rivals: FloatArray = dataclasses.field(
        default_factory=lambda: NONE_RIGHT
    )  # (m, 4, 4): from the truth to its equals
    equals: FloatArray = dataclasses.field(default_factory=lambda: NONE_RIGHT)  # (m + 1, 4, 4): Poses that fit as well
    options: dict[str, Any] = dataclasses.field(default_factory=dict)  # Of `dqreg.register`
    walls: Walls | None = None  # Whose sides a right pose tells apart


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """One sequence of frames for the odometry."""

    frames: tuple[FloatArray, ...]
    poses: FloatArray  # (f, 4, 4): T_first_frame
    allowed: float  # Displacement of the sensor beyond which a frame's pose is wrong


Make = Callable[[np.random.Generator], TrustTask | Drive]


@dataclasses.dataclass(frozen=True)
class Kind:
    """One kind of task."""

    name: str
    group: str
    good: bool  # Whether the right pose ought to be accepted; else nothing wrong may be
    words: str  # What it is, for the tables
    make: Make

    def task(self, seed: int) -> TrustTask | Drive:
        """The task of a seed: the same bytes every time."""
        return self.make(np.random.default_rng([zlib.crc32(self.name.encode()), seed]))


def kinds_of(group: str, good: bool, *named: tuple[str, str, Make]) -> tuple[Kind, ...]:
    """Kinds of one group."""
    return tuple(Kind(name, group, good, words, make) for name, words, make in named)


def on_part(
    scan: FloatArray,
    mesh: Mesh,
    rng: np.random.Generator,
    *,
    noise: float,
    start: tuple[float, float] | None = (8.0, 0.03),
    right: bool = True,
    T_off: FloatArray | None = None,
    rivals: FloatArray = NONE_RIGHT,
    **more: Any,
) -> TrustTask:
    """Task from a scan in the part's frame.

    The start is so many degrees and diagonals off, or wrong by the motion ``T_off`` besides; None is from nothing.
    """
    size = mesh.diagonal
    if start is None:
        T = pose.inverse(random_pose(rng, 0.8 * size, mesh.centre))
    else:
        T = disturbance(rng, np.deg2rad(start[0]), start[1] * size, mesh.centre)
        T = T if T_off is None else T @ T_off
    return TrustTask(
        pose.apply(pose.inverse(T), scan),
        mesh,
        None if start is None else "identity",
        T[None] if right else NONE_RIGHT,
        mesh.vertices,
        size,
        noise * size,
        rivals,
        np.concatenate([T[None], rivals @ T]),
        **more,
    )
