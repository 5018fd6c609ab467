"""Scans that show nothing of the target: noise, blobs, trees, rooms, patches without a shape."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.trust import scans, shapes
from dqreg.compare.trust.task import NONE_RIGHT, Kind, Make, TrustTask, kinds_of
from dqreg.geometry import Mesh, PointCloud
from dqreg.rigid import pose
from dqreg.synth import disturbance, random_pose
from dqreg.synth.parts import cylinder


def unrelated(source: FloatArray, target: Mesh | PointCloud, rng: np.random.Generator) -> TrustTask:
    """A task of which no pose is right, from nothing or from the middles laid on each other."""
    points = target.vertices if isinstance(target, Mesh) else target.points
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    return TrustTask(
        source,
        target,
        None if rng.uniform() < 0.5 else "identity",
        NONE_RIGHT,
        points,
        size,
        scans.NOISE_DIAGONALS * size,
    )


def noise(shape: Callable[[int, np.random.Generator], FloatArray]) -> Make:
    """Noise of the size of a part."""

    def make(rng: np.random.Generator) -> TrustTask:
        mesh = shapes.any_part(rng)
        count = int(10.0 ** rng.uniform(1.0, 3.5))
        extent = mesh.diagonal * np.array([0.3, 0.3, 0.3]) * rng.uniform(0.3, 1.2)
        if rng.uniform() < 0.4:
            extent = np.ptp(mesh.vertices, axis=0) * rng.uniform(0.4, 0.7)
        return unrelated(mesh.centre + extent * shape(count, rng), mesh, rng)

    return make


def gauss(count: int, rng: np.random.Generator) -> FloatArray:
    """A normal distribution."""
    return 0.5 * rng.normal(size=(count, 3))


def ball(count: int, rng: np.random.Generator) -> FloatArray:
    """A full ball."""
    return scans.directions(count, rng) * rng.uniform(size=(count, 1)) ** (1 / 3)


def shell(count: int, rng: np.random.Generator) -> FloatArray:
    """A rough sphere."""
    return scans.directions(count, rng) * (1.0 + rng.uniform(0.0, 0.1) * rng.normal(size=(count, 1)))


def cuboid(count: int, rng: np.random.Generator) -> FloatArray:
    """A full box."""
    return rng.uniform(-0.75, 0.75, (count, 3))


def repeated(count: int, rng: np.random.Generator) -> FloatArray:
    """Few places, each measured many times: no more evidence than the places."""
    places = gauss(int(rng.integers(15, 50)), rng)
    return places[rng.integers(len(places), size=max(count, 300))] + 1e-3 * rng.normal(size=(max(count, 300), 3))


def tree(count: int, rng: np.random.Generator) -> FloatArray:
    """Random branches."""
    starts, ends = [np.array([0.0, 0.0, -0.8])], [np.array([0.0, 0.0, 0.0])]
    for _ in range(int(rng.integers(8, 30))):
        parent = int(rng.integers(len(ends)))
        starts.append(ends[parent])
        ends.append(ends[parent] + rng.normal(size=3) * 0.25 + np.array([0.0, 0.0, 0.1]))
    pick, along = rng.integers(len(starts), size=max(count, 200)), rng.uniform(size=(max(count, 200), 1))
    points = np.array(starts)[pick] * (1 - along) + np.array(ends)[pick] * along
    return points + 0.02 * rng.normal(size=points.shape)


def room(count: int, rng: np.random.Generator) -> FloatArray:
    """Walls and furniture, seen from inside."""
    boxes = [(np.zeros(3), rng.uniform(0.5, 1.0, 3))]
    boxes += [(rng.uniform(-0.5, 0.5, 3), rng.uniform(0.05, 0.25, 3)) for _ in range(int(rng.integers(2, 7)))]
    parts = [middle + _box_surface(max(count, 400) // len(boxes), half, rng) for middle, half in boxes]
    return np.concatenate(parts)


def _box_surface(count: int, half: FloatArray, rng: np.random.Generator) -> FloatArray:
    points = rng.uniform(-1.0, 1.0, (count, 3))
    rows, axis = np.arange(count), rng.integers(3, size=count)
    points[rows, axis] = rng.choice([-1.0, 1.0], count)
    return points * half


def _wavy(rng: np.random.Generator) -> TrustTask:
    """A wavy sheet on a part with flat faces."""
    mesh = shapes.draw(shapes.plate if rng.uniform() < 0.5 else shapes.steps, rng)
    half = 0.3 * mesh.diagonal * rng.uniform(0.3, 1.0)
    flat = rng.uniform(-half, half, (int(rng.integers(200, 2000)), 2))
    height = 0.01 * mesh.diagonal * np.sin(flat @ rng.normal(size=2) * 6 / half) * rng.uniform(0.3, 2.0)
    return unrelated(mesh.centre + np.column_stack([flat, height]), mesh, rng)


def _flat_patch(rng: np.random.Generator) -> TrustTask:
    """A piece of one face: three motions are free."""
    mesh = shapes.draw(shapes.box, rng)
    half = 0.2 * np.ptp(mesh.vertices, axis=0).min()
    flat = rng.uniform(-half, half, (int(rng.integers(200, 2000)), 2))
    points = np.column_stack([flat, np.full(len(flat), mesh.vertices[:, 2].max())])
    points += scans.NOISE_DIAGONALS * mesh.diagonal * rng.normal(size=points.shape)
    T = disturbance(rng, np.deg2rad(2.0), 0.005 * mesh.diagonal, mesh.centre)
    return unrelated(pose.apply(T, points), mesh, rng)


def _round_patch(rng: np.random.Generator) -> TrustTask:
    """The side of a shaft without its ends, or a piece of a sphere: it turns or slides freely."""
    diameter, height = rng.uniform(20, 60), rng.uniform(60, 150)
    shaft = Mesh(*cylinder(diameter=diameter, height=height, segments=96))
    points = scans.sampled(shaft, 3000, rng)
    points = points[np.abs(points[:, 2]) < 0.5 * height * rng.uniform(0.5, 0.9)]
    T = disturbance(rng, np.deg2rad(4.0), 0.02 * height, np.zeros(3))
    return unrelated(pose.apply(T, points), shaft, rng)


def _two_blobs(rng: np.random.Generator) -> TrustTask:
    """A free-form body as a cloud on another one as a cloud."""
    one, other = (shapes.draw(shapes.lump, rng) for _ in range(2))
    level = 10.0 ** rng.uniform(-3.3, -2.3)
    scale = other.diagonal / one.diagonal
    points = [scans.sampled(mesh, int(rng.integers(400, 2500)), rng, level) for mesh in (one, other)]
    return unrelated(scale * points[0], PointCloud(points[1]), rng)


def _two_noises(rng: np.random.Generator) -> TrustTask:
    one, other = (30.0 * gauss(int(10.0 ** rng.uniform(1.3, 3.3)), rng) for _ in range(2))
    return unrelated(one, PointCloud(other), rng)


def _part_on_noise(rng: np.random.Generator) -> TrustTask:
    mesh = shapes.any_part(rng)
    scan = scans.two_views(mesh, rng)
    return unrelated(scan, PointCloud(mesh.centre + 0.3 * mesh.diagonal * ball(3000, rng)), rng)


def _one_profile(rng: np.random.Generator) -> TrustTask:
    """A single line of a profile scanner: most motions are held by its bends alone, or by nothing."""
    mesh = shapes.any_part(rng)
    normal, scan = scans.directions(1, rng)[0], scans.sampled(mesh, 60_000, rng)
    away = (scan - mesh.centre) @ normal
    line = scan[np.abs(away - rng.normal() * 0.1 * np.ptp(away)) < 2e-3 * mesh.diagonal][:1500]
    T = random_pose(rng, 0.3 * mesh.diagonal, mesh.centre)
    # A search may find its place all the same.
    return dataclasses.replace(unrelated(pose.apply(T, line), mesh, rng), truths=pose.inverse(T)[None])


KINDS: tuple[Kind, ...] = kinds_of(
    "chance",
    False,
    ("noise-gauss", "10 to 3,000 points of Gaussian noise", noise(gauss)),
    ("noise-ball", "points that fill a ball", noise(ball)),
    ("noise-shell", "points on a rough sphere", noise(shell)),
    ("noise-box", "points that fill a box", noise(cuboid)),
    ("noise-repeated", "few random places, measured often", noise(repeated)),
    ("tree", "random branches", noise(tree)),
    ("room", "walls and furniture on a part", noise(room)),
    ("wavy-sheet", "a wavy sheet on flat faces", _wavy),
    ("flat-patch", "a piece of one face", _flat_patch),
    ("round-patch", "the side of a shaft without its ends", _round_patch),
    ("two-blobs", "a free-form body on another, as clouds", _two_blobs),
    ("two-noises", "noise on noise", _two_noises),
    ("part-on-noise", "a scan of a part on noise", _part_on_noise),
    ("one-profile", "a single profile line, far from its place", _one_profile),
)
