"""Clouds on clouds: views of one object that overlap much, little or not at all."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.trust import scans, shapes
from dqreg.compare.trust.task import NONE_RIGHT, Kind, Make, Task, kinds_of
from dqreg.geometry import Mesh, PointCloud
from dqreg.rigid import pose
from dqreg.synth import disturbance, random_pose


def cloud_task(
    source: FloatArray,
    target: FloatArray,
    mesh: Mesh,
    rng: np.random.Generator,
    start: tuple[float, float] | None,
    *,
    right: bool = True,
    noise: float = scans.NOISE,
) -> Task:
    """Task of two scans in the part's frame."""
    size = mesh.diagonal
    T = pose.inverse(random_pose(rng, 0.8 * size, mesh.centre))
    if start is not None:
        T = disturbance(rng, np.deg2rad(start[0]), start[1] * size, mesh.centre)
    begun = None if start is None else "identity"
    truths = T[None] if right else NONE_RIGHT
    return Task(
        pose.apply(pose.inverse(T), source), PointCloud(target), begun, truths, mesh.vertices, size, noise * size
    )


def views_apart(
    low: float,
    high: float,
    start: tuple[float, float] | None,
    family: shapes.Family | None = None,
    far: tuple[float, float] | None = None,
) -> Make:
    """Two views so many degrees apart, or a start between two bounds of degrees off."""

    def make(rng: np.random.Generator) -> Task:
        mesh = shapes.any_part(rng) if family is None else shapes.draw(family, rng)
        one = scans.oblique(rng)
        one /= np.linalg.norm(one)
        across = np.cross(one, scans.directions(1, rng)[0])
        turn = np.deg2rad(rng.uniform(low, high)) * across / np.linalg.norm(across)
        other = pose.exp(np.concatenate([turn, np.zeros(3)]))[:3, :3] @ one
        begun = start if far is None else (rng.uniform(*far), 0.1)
        return cloud_task(scans.dense_view(mesh, rng, one), scans.dense_view(mesh, rng, other), mesh, rng, begun)

    return make


def _two_parts(rng: np.random.Generator) -> Task:
    one, other = shapes.any_part(rng), shapes.any_part(rng)
    scale = other.diagonal / one.diagonal
    source = (scans.two_views(one, rng) - one.centre) * scale + other.centre
    return cloud_task(source, scans.two_views(other, rng), other, rng, None, right=False)


def _slid_plates(rng: np.random.Generator) -> Task:
    """Upper and lower side of a thin plate, begun on each other."""
    mesh = shapes.draw(shapes.plate, rng)
    up = np.array([0.2 * rng.normal(), 0.2 * rng.normal(), 1.0])
    scan, target = scans.dense_view(mesh, rng, up), scans.dense_view(mesh, rng, -up)
    return cloud_task(scan, target, mesh, rng, (3.0, 0.03))


KINDS: tuple[Kind, ...] = (
    *kinds_of(
        "good",
        True,
        ("clouds-10-30", "views 10 to 30 degrees apart, start 5 degrees off", views_apart(10, 30, (5.0, 0.02))),
        ("clouds-30-50", "views 30 to 50 degrees apart, start 5 degrees off", views_apart(30, 50, (5.0, 0.02))),
        ("clouds-nothing", "views 10 to 40 degrees apart, no initial pose", views_apart(10, 40, None)),
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
    ),
)  # fmt: skip
