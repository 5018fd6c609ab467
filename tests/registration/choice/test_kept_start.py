"""Two views of a nearly symmetric part: what they have in common leaves no start, and accepts no twin from nothing."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest

from dqreg.geometry import PointCloud
from dqreg.registration.fit.fit import Fit
from dqreg.registration.register import register
from dqreg.rigid import pose
from dqreg.synth import random_pose
from dqreg.synth.parts import box
from dqreg.synth.raycast import first_hits

# Sizes and middles of boxes: a plate with four lugs, of which one is lower; a block with one boss.
PLATE = (((80, 80, 10), (0, 0, 0)), *(((8, 8, 8), (x, y, 9)) for x, y in ((-32, -32), (32, -32), (32, 32))))
PARTS = {
    "plate": (*PLATE, ((8, 8, 6), (-32, 32, 8))),
    "block": (((60, 60, 30), (0, 0, 0)), ((8, 8, 5), (18, 10, 17.5))),
    "hexagon": (((8, 10, 6), (15, 5, 17)),),
}
# Sides, radius and height of a prism that carries such a box.
PRISMS = {"hexagon": (6, 30.0, 30.0)}


def soaked(*cases: tuple[str, int, float]) -> list[Any]:
    """Cases that say the same, of four times as many points, are run with the long tests."""
    return [pytest.param(*case, 2 * PIXELS, marks=pytest.mark.soak) for case in cases]


# The width of what is seen is a share of its depth.
NOISE_DIAGONALS, WIDTH_DEPTHS = 3e-4, 0.55
PIXELS, AWAY_DIAGONALS = 110, 3.0
# Part, seed, degrees between two views and pixels of each along a side.
STARTED = [("plate", 8, 110.0, PIXELS), ("block", 10, 90.0, PIXELS)]
STARTED += soaked(("plate", 8, 110.0), ("plate", 13, 110.0), ("plate", 18, 110.0), ("block", 10, 90.0))
FROM_NOTHING = [("plate", 13, 110.0, PIXELS), ("block", 10, 90.0, PIXELS)]
FROM_NOTHING += soaked(("plate", 5, 110.0), ("plate", 8, 110.0), ("plate", 13, 110.0), ("plate", 18, 110.0))
FROM_NOTHING += soaked(("block", 5, 110.0), ("block", 10, 90.0), ("block", 20, 70.0))
ACCEPTED = 115
# What an accepted pose is off at most, and a kept start, in sizes.
RIGHT, KEPT = 0.03, 0.2


def prism(sides: int, radius: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    """A prism about z: vertices of both ends, then the middles of these; triangles."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = [np.c_[ring, np.full(sides, z)] for z in (-0.5 * height, 0.5 * height)]
    one, other = np.arange(sides), np.roll(np.arange(sides), -1)
    low, high = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    walls = [np.c_[one, other, one + sides], np.c_[other, other + sides, one + sides]]
    caps = [np.c_[other, one, low], np.c_[one + sides, other + sides, high]]
    return np.concatenate([*ends, [[0, 0, -0.5 * height], [0, 0, 0.5 * height]]]), np.concatenate([*walls, *caps])


def mesh(name: str) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces, count = [], [], 0
    if name in PRISMS:
        points, triangles = prism(*PRISMS[name])
        vertices, faces, count = [points], [triangles], len(points)
    for size, middle in PARTS[name]:
        points, triangles = box(tuple(map(float, size)))
        points = points - 0.5 * (points.min(axis=0) + points.max(axis=0)) + np.array(middle)
        vertices.append(points)
        faces.append(triangles + count)
        count += len(points)
    return np.concatenate(vertices), np.concatenate(faces)


def view(name: str, towards: np.ndarray, pixels: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points of a depth camera in its frame, (n, 3), and the pose of that in the part's, (4, 4)."""
    vertices, faces = mesh(name)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    right = np.cross(rng.normal(size=3), towards)
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(-towards, right), -towards], axis=1)
    eye = vertices.mean(axis=0) + AWAY_DIAGONALS * size * towards
    u, v = np.meshgrid(*2 * [WIDTH_DEPTHS * ((np.arange(pixels) + 0.5) / pixels - 0.5)])
    rays = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3)
    points = (first_hits(vertices, faces, np.tile(eye, (len(rays), 1)), rays @ R.T)[1] - eye) @ R
    depths = points[:, 2] + NOISE_DIAGONALS * size * rng.normal(size=len(points))
    return (rays * depths[:, None])[np.isfinite(depths)], pose.from_parts(R, eye)


@functools.cache
def views(name: str, seed: int, degrees: float, pixels: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Points of two views so far apart, the pose from the second to the first, (4, 4), and the size of the part."""
    rng = np.random.default_rng(seed)
    one = rng.normal(size=3)
    one /= np.linalg.norm(one)
    across = np.cross(one, rng.normal(size=3))
    turn = pose.exp(np.r_[np.deg2rad(degrees) * across / np.linalg.norm(across), np.zeros(3)])[:3, :3]
    (target, A), (source, B) = (view(name, towards, pixels, rng) for towards in (one, turn @ one))
    return source, target, pose.inverse(A) @ B, float(np.linalg.norm(np.ptp(mesh(name)[0], axis=0)))


def off(T: np.ndarray, truth: np.ndarray, source: np.ndarray, size: float) -> float:
    """How far a pose puts a point of the source from its place at most, in sizes."""
    return float(np.linalg.norm(pose.apply(T, source) - pose.apply(truth, source), axis=1).max()) / size


# The frame of the source is another one each time, so that the motion is.
@pytest.mark.parametrize("frame", [pytest.param(0, marks=pytest.mark.soak), 1])
@pytest.mark.parametrize("search", ["never", "doubt"])
@pytest.mark.parametrize(("name", "seed", "degrees", "pixels"), STARTED)
def test_a_true_start_is_never_left_for_a_twin(
    name: str, seed: int, degrees: float, pixels: int, search: str, frame: int
) -> None:
    source, target, truth, size = views(name, seed, degrees, pixels)
    F = random_pose(np.random.default_rng(frame), size, np.zeros(3)) if frame else np.eye(4)
    moved, start = PointCloud(pose.apply(F, source), viewpoint=F[:3, 3]), truth @ pose.inverse(F)
    found = register(moved, PointCloud(target, viewpoint=np.zeros(3)), start, search=search, effort="fast")
    away = off(found.T_target_source, start, moved.points, size)
    assert away < KEPT
    assert found.verdict.level != "accepted" or away < RIGHT


@pytest.mark.parametrize(("name", "seed", "degrees", "pixels"), FROM_NOTHING)
def test_from_nothing_no_twin_is_accepted_for_what_it_has_in_common(
    name: str, seed: int, degrees: float, pixels: int
) -> None:
    """The answer is the right pose, or one beside which others are named."""
    source, target, truth, size = views(name, seed, degrees, pixels)
    found = register(source, target, effort="fast")
    is_right = off(found.T_target_source, truth, source, size) < RIGHT
    assert is_right or (found.verdict.level, "alternative_poses" in found.verdict.codes) == ("suspect", True)


def test_from_nothing_a_prism_is_compared_after_its_steps() -> None:
    # Four planes are in common, after a step of a sixth as well: that pose was accepted, and no other named.
    source, target, truth, size = views("hexagon", 1, 40.0, PIXELS)
    found = register(
        PointCloud(source, viewpoint=np.zeros(3)), PointCloud(target, viewpoint=np.zeros(3)), effort="fast"
    )
    poses = [found.T_target_source, *(other.T_target_source for other in found.alternatives)]
    assert min(off(T, truth, source, size) for T in poses) < 0.03
    assert "alternative_poses" in found.verdict.codes


@pytest.mark.parametrize("method", ["auto", "plane"])
def test_a_chosen_method_finds_its_own_kernel(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A loop that leaves its start is asked with a narrow kernel, by "auto" alone: "plane" was handed one there."""
    scales, resumed = [], Fit.resumed

    def watched(fit: Fit, start: np.ndarray, kernel_scale: float | None, **more: Any) -> Fit:
        scales.append(kernel_scale)
        return resumed(fit, start, kernel_scale, **more)

    monkeypatch.setattr(Fit, "resumed", watched)
    source, target, truth, size = views("block", 10, 90.0, 60)
    off_it = pose.exp(np.array([0.4, -0.3, 0.3, 0.15 * size, 0.0, 0.0]))
    start = pose.about(off_it, pose.apply(truth, source).mean(axis=0)) @ truth
    register(source, target, start, method=method, search="always", effort="fast")
    assert any(scale is not None for scale in scales) == (method == "auto")


def test_a_start_beside_the_pose_is_accepted_as_before() -> None:
    """Nothing is asked of a pose that the initial one meant, at which the views have much in common."""
    source, target, truth, size = views("block", ACCEPTED, 15.0, 2 * PIXELS)
    start = truth @ pose.exp(np.array([0.03, -0.02, 0.03, 0.01, 0.02, -0.01]) * np.r_[1.0, 1.0, 1.0, size, size, size])
    found = register(source, target, start, effort="fast")
    assert found.verdict.level == "accepted"
    assert off(found.T_target_source, truth, source, size) < 0.01
