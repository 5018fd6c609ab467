"""Odometry through simulated places: a frame that is lost or stuck must not be accepted."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.trust.shapes import joined
from dqreg.compare.trust.task import Drive, Kind, kinds_of
from dqreg.geometry import Mesh
from dqreg.rigid import pose
from dqreg.synth.parts import box
from dqreg.synth.street import swept, with_range_noise

DRIVE_FRAMES = 8
LIDAR_RINGS, LIDAR_COLUMNS = 32, 450
MAX_RANGE, RANGE_SIGMA = 25.0, 0.01


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """A block between two corners."""
    a, b = np.array(low), np.array(high)
    vertices, faces = box(tuple(b - a))
    return Mesh(vertices + 0.5 * (a + b), faces)


def frame(scene: Mesh, T: FloatArray, rng: np.random.Generator) -> FloatArray:
    """What a spinning LiDAR sees from a pose, in its own frame."""
    azimuths = np.arange(LIDAR_COLUMNS) * 2 * np.pi / LIDAR_COLUMNS + rng.uniform(0, 2 * np.pi / LIDAR_COLUMNS)
    seen = swept((scene.vertices, scene.faces), T, np.deg2rad(np.linspace(-22, 22, LIDAR_RINGS)), azimuths)
    kept: FloatArray = with_range_noise(seen, RANGE_SIGMA, rng)[np.linalg.norm(seen, axis=1) < MAX_RANGE]
    return kept


def drive(scene: Mesh, poses: FloatArray, rng: np.random.Generator) -> Drive:
    """Frames along poses in a scene; the map's frame is the first frame's."""
    frames = tuple(frame(scene, T, rng) for T in poses)
    return Drive(frames, pose.inverse(poses[0]) @ poses, allowed=0.3)


def straight(step: float, rng: np.random.Generator) -> FloatArray:
    """Poses along x with a little sway."""
    poses = []
    for k in range(DRIVE_FRAMES):
        turn = np.deg2rad(2.0) * rng.normal(size=3) * [0.1, 0.1, 1.0]
        T = pose.exp(np.concatenate([turn, np.zeros(3)]))
        T[:3, 3] = [k * step, 0.02 * rng.normal(), 1.2]
        poses.append(T)
    return np.stack(poses)


def corridor(rng: np.random.Generator, pitch: float, depth: float) -> Mesh:
    """A corridor with pilasters on both sides at equal distances; no ends within reach."""
    width, height, long = rng.uniform(2.5, 5.0), rng.uniform(2.4, 3.5), 60.0
    half = 0.5 * width
    pieces = [
        block((-long, -half - 0.2, -0.1), (long, half + 0.2, 0.0)),
        block((-long, -half - 0.2, height), (long, half + 0.2, height + 0.1)),
        block((-long, -half - 0.2, 0.0), (long, -half, height)),
        block((-long, half, 0.0), (long, half + 0.2, height)),
    ]
    if depth > 0.0:
        wide = rng.uniform(0.2, 0.5)
        for x in np.arange(-long + rng.uniform(0, pitch), long - 1.0, pitch):
            pieces.append(block((x, -half, 0.0), (x + wide, -half + depth, height)))
            pieces.append(block((x, half - depth, 0.0), (x + wide, half, height)))
    return joined(*pieces)


def _pilasters(rng: np.random.Generator) -> Drive:
    pitch = rng.uniform(2.0, 6.0)
    return drive(corridor(rng, pitch, rng.uniform(0.1, 0.3)), straight(rng.uniform(0.15, 0.45) * pitch, rng), rng)


def _bare(rng: np.random.Generator) -> Drive:
    return drive(corridor(rng, 5.0, 0.0), straight(rng.uniform(0.3, 1.5), rng), rng)


def _jump(rng: np.random.Generator) -> Drive:
    """A drive through a hall of equal columns of which one frame jumps by a period."""
    pitch = rng.uniform(3.0, 5.0)
    half = 12.0
    columns = [
        block((x - 0.2, y - 0.2, 0.0), (x + 0.2, y + 0.2, 4.0))
        for x in np.arange(-7, 11) * pitch for y in np.arange(-3, 4) * pitch + 0.5 * pitch
    ]  # fmt: skip
    floor = [block((-80, -half - 9, -0.1), (80, half + 9, 0.0)), block((-80, -half - 9, 4.0), (80, half + 9, 4.1))]
    poses = straight(0.3, rng)
    poses[DRIVE_FRAMES // 2 :, 0, 3] += pitch
    return drive(joined(*floor, *columns), poses, rng)


def _hall(rng: np.random.Generator) -> Drive:
    """A good drive: a hall with furniture at random."""
    a, b, c = rng.uniform(8, 18), rng.uniform(6, 14), rng.uniform(3, 6)
    walls = [
        block((-a, -b, -0.1), (a, b, 0.0)), block((-a, -b, c), (a, b, c + 0.1)),
        block((-a - 0.1, -b, 0.0), (-a, b, c)), block((a, -b, 0.0), (a + 0.1, b, c)),
        block((-a, -b - 0.1, 0.0), (a, -b, c)), block((-a, b, 0.0), (a, b + 0.1, c)),
    ]  # fmt: skip
    for _ in range(int(rng.integers(6, 14))):
        x, y = rng.uniform(-a, a), rng.choice([-1.0, 1.0]) * rng.uniform(2.0, b)
        w, d, h = rng.uniform(0.3, 2.0, 3)
        walls.append(block((x - w, y - d, 0.0), (x + w, y + d, h)))
    poses = straight(rng.uniform(0.1, 0.6), rng)
    poses[:, 0, 3] -= 0.4 * a
    return drive(joined(*walls), poses, rng)


KINDS: tuple[Kind, ...] = (
    *kinds_of("good", True, ("drive-hall", "odometry through a hall with furniture", _hall)),
    *kinds_of(
        "drives",
        False,
        ("drive-pilasters", "odometry along equal pilasters", _pilasters),
        ("drive-bare", "odometry along bare walls", _bare),
        ("drive-jump", "a jump by one period in a hall of equal columns", _jump),
    ),
)
