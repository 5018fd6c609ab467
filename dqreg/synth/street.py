"""A street as a car's LiDAR sees it: ground, houses, parked cars, trees and posts; lengths in metres."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import pose
from dqreg.synth.parts import box
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.raycast import first_hits

# The street runs along x for so much to both sides of the origin.
HALF_LENGTH_M = 120.0
# Kerbs are so far from its middle, and so high.
KERB_DISTANCE_M, KERB_HEIGHT_M = 5.0, 0.15
# Leaves of a tree, and their size.
LEAVES_PER_TREE, LEAF_SIGMA_M = 600, 0.12


def street(rng: np.random.Generator) -> Mesh:
    """A street with houses, cars, trees and posts at random along both sides: vertices and faces."""
    parts = [_ground(rng)]
    for side in (-1.0, 1.0):
        x = -HALF_LENGTH_M
        while x < HALF_LENGTH_M:
            width, deep, high = rng.uniform([6.0, 6.0, 4.0], [20.0, 12.0, 14.0])
            away = side * (rng.uniform(9.0, 16.0) + 0.5 * deep)
            if rng.random() < 0.75:
                parts.append(
                    _block((width, deep, high), (x + 0.5 * width, away, 0.5 * high - 1.0), 0.03 * rng.normal())
                )
            x += width + rng.uniform(0.0, 6.0)
        for x in rng.uniform(-HALF_LENGTH_M, HALF_LENGTH_M, 24):
            parts += _car(x, side * rng.uniform(4.0, 7.0), rng)
        for x in rng.uniform(-HALF_LENGTH_M, HALF_LENGTH_M, int(rng.integers(8, 20))):
            parts += _tree(x, side * rng.uniform(7.0, 15.0), rng)
        parts += [
            _block((0.16, 0.16, 6.0), (x, side * 6.5, 3.0)) for x in rng.uniform(-HALF_LENGTH_M, HALF_LENGTH_M, 16)
        ]
    return together(parts)


def together(parts: list[Mesh]) -> Mesh:
    """Meshes in one."""
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    faces = [np.asarray(each) + offset for (_, each), offset in zip(parts, offsets, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def swept(scene: Mesh, T_scene_sensor: FloatArray, elevations: FloatArray, azimuths: FloatArray) -> FloatArray:
    """Where the beams of one turn of a LiDAR end, ring by ring, in its own frame, (n, 3); of those that meet anything.

    Angles are in rad, elevations of the rings and azimuths of the columns; the sensor stands still meanwhile.
    """
    azimuth, elevation = np.meshgrid(azimuths, elevations)
    flat = np.cos(elevation)
    rays = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)
    origins = np.tile(T_scene_sensor[:3, 3], (len(rays), 1))
    face, points = first_hits(*scene, origins, rays @ T_scene_sensor[:3, :3].T)
    seen: FloatArray = pose.apply(pose.inverse(T_scene_sensor), points[face >= 0])
    return seen


def with_range_noise(points: FloatArray, sigma: float, rng: np.random.Generator) -> FloatArray:
    """Points in the sensor's frame with noise along their beams, a length."""
    ranges = np.linalg.norm(points, axis=1, keepdims=True)
    noisy: FloatArray = points * (1.0 + sigma * rng.normal(size=ranges.shape) / ranges)
    return noisy


def _ground(rng: np.random.Generator) -> Mesh:
    """Low waves, a kerb high on both sides and lower in the lane."""
    x, y = np.meshgrid(np.arange(-HALF_LENGTH_M, HALF_LENGTH_M + 1.0), np.arange(-60.0, 61.0), indexing="ij")
    waves = np.zeros(x.shape)
    for _ in range(6):
        (k, m), (a, b), height = rng.uniform(0.05, 0.4, 2), rng.uniform(0.0, 2.0 * np.pi, 2), rng.uniform(0.0, 0.08)
        waves += height * np.sin(k * x + a) * np.cos(m * y + b)
    z = np.where(np.abs(y) < KERB_DISTANCE_M, 0.3 * waves, waves + KERB_HEIGHT_M)
    row = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (some.ravel() for some in (row[:-1, :-1], row[1:, :-1], row[1:, 1:], row[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), faces


def _block(size: tuple[float, float, float], middle: tuple[float, float, float], turn_rad: float = 0.0) -> Mesh:
    vertices, faces = box(size)
    T = pose.exp(np.r_[0.0, 0.0, turn_rad, 0.0, 0.0, 0.0])
    T[:3, 3] = middle
    return pose.apply(T, vertices), faces


def _car(x: float, y: float, rng: np.random.Generator) -> list[Mesh]:
    long, turn_rad = rng.uniform(3.5, 4.8), 0.05 * rng.normal()
    return [_block((long, 1.8, 0.7), (x, y, 0.55), turn_rad), _block((0.6 * long, 1.6, 0.6), (x, y, 1.2), turn_rad)]


def _tree(x: float, y: float, rng: np.random.Generator) -> list[Mesh]:
    """A trunk, and leaves that fill a ball."""
    high, radius = rng.uniform(2.0, 4.0), rng.uniform(1.0, 2.5)
    ways = rng.normal(size=(LEAVES_PER_TREE, 3))
    ways *= radius * np.cbrt(rng.uniform(size=(LEAVES_PER_TREE, 1))) / np.linalg.norm(ways, axis=1, keepdims=True)
    middles = ways + np.array([x, y, high + radius])
    corners = middles[:, None] + LEAF_SIGMA_M * rng.normal(size=(LEAVES_PER_TREE, 3, 3))
    leaves = corners.reshape(-1, 3), np.arange(3 * LEAVES_PER_TREE).reshape(-1, 3)
    return [_block((0.3, 0.3, high), (x, y, 0.5 * high)), leaves]
