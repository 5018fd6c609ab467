"""Clouds on clouds: views of one object that overlap much, little or not at all."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, bounds
from dqreg.compare.trust import scans, shapes
from dqreg.compare.trust.task import NONE_RIGHT, Kind, Make, TrustTask, kinds_of
from dqreg.geometry import Mesh, MeshSurface, PointCloud
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes
from dqreg.rigid import pose
from dqreg.solvers.quadratic import plane_rows
from dqreg.synth import disturbance, random_pose
from dqreg.synth.many_views import room_stops

# Views of a good task are drawn anew, so often at most, until what both show determines the pose:
MAX_DRAWS = 30
# points of one within so many spacings of the other, on the same face;
SHARED_SPACINGS, SAME_FACE_COS = 1.5, 0.9
# the weakest motion is constrained by so many, and by this share of what all could give with the longest lever.
MIN_CARRIERS, MIN_INFORMATION_SHARE = 60.0, 2e-3
# What a change of one view shows at least on the surface that both show, along its normals and beyond any motion, root
# mean square in sizes. Measured scans of one figure (the bunny's) differ as smoothly by up to 4.7e-4.
MIN_CHANGE_SIZES = 5e-4
# Noise that neighbours share, in that from point to point: measured pairs have several times as much.
SHARED_NOISE_RATIOS = (0.3, 1.0)
# Rings of the LiDAR of a room, and its noise.
ROOM_RINGS, ROOM_NOISE = (32, 48, 64), 0.005


def cloud_task(
    source: FloatArray,
    target: FloatArray,
    mesh: Mesh,
    rng: np.random.Generator,
    start: tuple[float, float] | None,
    *,
    right: bool = True,
) -> TrustTask:
    """Task of two scans in the part's frame."""
    size = mesh.diagonal
    T = pose.inverse(random_pose(rng, 0.8 * size, mesh.centre))
    if start is not None:
        T = disturbance(rng, np.deg2rad(start[0]), start[1] * size, mesh.centre)
    begun = None if start is None else "identity"
    truths = T[None] if right else NONE_RIGHT
    return TrustTask(
        pose.apply(pose.inverse(T), source),
        PointCloud(target),
        begun,
        truths,
        mesh.vertices,
        size,
        scans.NOISE_DIAGONALS * size,
    )


def views_apart(
    low: float,
    high: float,
    start: tuple[float, float] | None,
    family: shapes.Family | None = None,
    far: tuple[float, float] | None = None,
    *,
    determined: bool = False,
    shared: tuple[float, float] | None = None,
) -> Make:
    """Two views so many degrees apart, or a start between two bounds of degrees off.

    Those of a good task determine the pose: what both show constrains all motions, by the part's own normals. Some have
    noise that neighbours share beside their own, between two shares of it.
    """

    def make(rng: np.random.Generator) -> TrustTask:
        for _ in range(MAX_DRAWS):
            mesh = shapes.any_part(rng) if family is None else shapes.draw(family, rng)
            one = scans.oblique(rng)
            one /= np.linalg.norm(one)
            across = np.cross(one, scans.directions(1, rng)[0])
            turn = np.deg2rad(rng.uniform(low, high)) * across / np.linalg.norm(across)
            other = pose.exp(np.concatenate([turn, np.zeros(3)]))[:3, :3] @ one
            begun = start if far is None else (rng.uniform(*far), 0.1)
            source, target = scans.dense_view(mesh, rng, one), scans.dense_view(mesh, rng, other)
            if not determined or _is_determined(source, target, mesh):
                break
        if shared is not None:
            sigmas = scans.NOISE_DIAGONALS * mesh.diagonal * rng.uniform(*shared, 2)
            source = scans.shared_noise(source, one, sigmas[0], rng)
            target = scans.shared_noise(target, other, sigmas[1], rng)
        return cloud_task(source, target, mesh, rng, begun)

    return make


def _is_determined(source: FloatArray, target: FloatArray, mesh: Mesh) -> bool:
    """Whether the points that both views show constrain all six motions."""
    from dqreg.trust.information import information_of

    surface = MeshSurface(mesh)
    spacing = float(np.median(NeighbourTree(target).nearest(target, 2)[1][:, 1]))
    rows, apart = NeighbourTree(target).nearest(source, 1)
    normals, theirs = (surface.closest(points).normals for points in (source, target))
    shared = (apart[:, 0] < SHARED_SPACINGS * spacing) & (
        np.einsum("ij,ij->i", normals, theirs[rows[:, 0]]) > SAME_FACE_COS
    )
    if not shared.any():
        return False
    one = np.ones(np.count_nonzero(shared))
    found = information_of(source[shared], normals[shared], 0.0 * one, one, 0.5 * mesh.diagonal, mesh.centre)
    return bool(found.carriers.min() >= MIN_CARRIERS and found.values.min() >= MIN_INFORMATION_SHARE)


def _two_parts(rng: np.random.Generator) -> TrustTask:
    one, other = shapes.any_part(rng), shapes.any_part(rng)
    scale = other.diagonal / one.diagonal
    source = (scans.two_views(one, rng) - one.centre) * scale + other.centre
    return cloud_task(source, scans.two_views(other, rng), other, rng, None, right=False)


def _one_family(rng: np.random.Generator) -> TrustTask:
    """Views of two parts of one family and size: corners of one fit those of the other."""
    family = shapes.ASYMMETRIC[rng.integers(len(shapes.ASYMMETRIC))]
    one, other = shapes.draw(family, rng), shapes.draw(family, rng)
    scan = (scans.dense_view(one, rng, scans.oblique(rng)) - one.centre) * (other.diagonal / one.diagonal)
    start = (rng.uniform(0.0, 40.0), 0.05) if rng.uniform() < 0.5 else None
    target = scans.dense_view(other, rng, scans.oblique(rng))
    return cloud_task(scan + other.centre, target, other, rng, start, right=False)


def _changed(change: Callable[[FloatArray, float, np.random.Generator], FloatArray]) -> Make:
    """Two views up to 30 degrees apart, of which one is changed by a function of its points about the middle.

    Both are drawn anew, so often at most, until the change shows on what both show.
    """

    def make(rng: np.random.Generator) -> TrustTask:
        for _ in range(MAX_DRAWS):
            task = views_apart(0.0, 30.0, (5.0, 0.02), determined=True)(rng)
            assert isinstance(task, TrustTask)
            assert isinstance(task.source, np.ndarray)
            middle = task.source.mean(axis=0)
            changed = dataclasses.replace(task, source=middle + change(task.source - middle, task.size, rng))
            if _shown(task, changed) >= MIN_CHANGE_SIZES * task.size:
                break
        return dataclasses.replace(changed, truths=NONE_RIGHT)

    return make


def _shown(task: TrustTask, changed: TrustTask) -> float:
    """Displacement of a changed source along the normals of what both show, beyond any motion, root mean square."""
    assert isinstance(task.target, PointCloud)
    target = task.target.points
    tree = NeighbourTree(target)
    spacing = float(np.median(tree.nearest(target, 2)[1][:, 1]))
    placed, moved = (pose.apply(task.truths[0], np.asarray(each.source)) for each in (task, changed))
    both = tree.nearest(placed, 1)[1][:, 0] < SHARED_SPACINGS * spacing
    points, normals = placed[both], np.nan_to_num(fit_planes(tree, target, placed[both]).normals)
    along = np.einsum("ij,ij->i", moved[both] - points, normals)
    motions = plane_rows(points, normals, points.mean(axis=0), 0.5 * task.size)
    left = along - np.linalg.lstsq(motions.T, along, rcond=None)[0] @ motions
    return float(np.sqrt(np.mean(left**2)))


def _strained(points: FloatArray, size: float, rng: np.random.Generator) -> FloatArray:
    """A stretch along any axis, or a shear, of 1.5 to 6 %."""
    along, other = scans.directions(2, rng)
    strain = rng.uniform(0.015, 0.06) * rng.choice([-1.0, 1.0])
    across = along if rng.uniform() < 0.5 else other
    changed: FloatArray = points + strain * (points @ along)[:, None] * across
    return changed


def _rippled(points: FloatArray, size: float, rng: np.random.Generator) -> FloatArray:
    """Waves of 0.3 to 0.6 % of the size, two to eight of them."""
    along, across = scans.directions(2, rng)
    waves = 2.0 * np.pi * rng.uniform(2.0, 8.0) / size
    changed: FloatArray = points + rng.uniform(0.003, 0.006) * size * np.sin(waves * points @ along)[:, None] * across
    return changed


def _moved(points: FloatArray, size: float, rng: np.random.Generator) -> FloatArray:
    """A shift by 1.5 to 3 % of the size from the first point to the last."""
    shift = rng.uniform(0.015, 0.03) * size * scans.directions(1, rng)
    changed: FloatArray = points + np.linspace(-0.5, 0.5, len(points))[:, None] * shift
    return changed


def _slid_plates(rng: np.random.Generator) -> TrustTask:
    """Upper and lower side of a thin plate, begun on each other."""
    mesh = shapes.draw(shapes.plate, rng)
    up = np.array([0.2 * rng.normal(), 0.2 * rng.normal(), 1.0])
    scan, target = scans.dense_view(mesh, rng, up), scans.dense_view(mesh, rng, -up)
    return cloud_task(scan, target, mesh, rng, (3.0, 0.03))


def _room(rng: np.random.Generator) -> TrustTask:
    """Two of three stops of a LiDAR in a furnished room, each in its frame: from nothing, or from five degrees off."""
    made = room_stops(3, rings=int(rng.choice(ROOM_RINGS)), rng=rng)
    i, j = rng.choice(3, 2, replace=False)
    source, target = made.scans[j], made.scans[i]
    T = pose.inverse(made.T_world_scan[i]) @ made.T_world_scan[j]
    low, high = bounds(target)
    size = float(np.linalg.norm(high - low))
    start = None if rng.uniform() < 0.5 else disturbance(rng, np.deg2rad(5.0), 0.02 * size, 0.5 * (low + high)) @ T
    return TrustTask(source, PointCloud(target), start, T[None], pose.apply(T, source[::50]), size, ROOM_NOISE)


KINDS: tuple[Kind, ...] = (
    *kinds_of(
        "good",
        True,
        ("clouds-10-30", "views 10 to 30 degrees apart, start 5 degrees off",
         views_apart(10, 30, (5.0, 0.02), determined=True)),
        ("clouds-30-50", "views 30 to 50 degrees apart, start 5 degrees off",
         views_apart(30, 50, (5.0, 0.02), determined=True)),
        ("clouds-nothing", "views 10 to 40 degrees apart, no initial pose", views_apart(10, 40, None, determined=True)),
        ("clouds-shared", "views 10 to 40 degrees apart, start 5 degrees off, noise shared by 100 to 500 neighbours",
         views_apart(10, 40, (5.0, 0.02), determined=True, shared=SHARED_NOISE_RATIOS)),
        ("clouds-nothing-shared", "the same with no initial pose",
         views_apart(10, 40, None, determined=True, shared=SHARED_NOISE_RATIOS)),
    ),
    *kinds_of(
        "clouds",
        False,
        ("clouds-opposite", "views from opposite sides, no initial pose", views_apart(150, 180, None)),
        ("clouds-opposite-lump", "the same of free-form bodies", views_apart(150, 180, None, shapes.lump)),
        ("clouds-far-start", "views 20 to 50 degrees apart, start 60 to 180 off",
         views_apart(20, 50, None, far=(60.0, 180.0))),
        ("clouds-plate-sides", "both sides of a thin plate on each other", _slid_plates),
        ("clouds-two-parts", "views of two parts of one size", _two_parts),
        ("clouds-one-family", "views of two parts of one family, from nothing or up to 40 degrees off", _one_family),
        ("clouds-strained", "views of which one is stretched or sheared by 1.5 to 6 %", _changed(_strained)),
        ("clouds-rippled", "views of which one has waves of 0.3 to 0.6 %", _changed(_rippled)),
        ("clouds-room", "two stops of a LiDAR in a furnished room, from nothing or 5 degrees off", _room),
        ("clouds-moved", "views of which one moved by 1.5 to 3 % of the size", _changed(_moved)),
    ),
)  # fmt: skip
