"""Slots: exact and noisy walls at any place, derivatives, and slots of a plan made of several faces."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import fit_feature, inspect, measure_deviations, part_faces
from dqreg.inspection.features.models import Shape, distances
from dqreg.inspection.features.starts import frame_along
from dqreg.inspection.plan.file import plan_of
from dqreg.rigid import pose

WIDTH, LENGTH, DEPTH = 8.0, 20.0, 5.0


def outline(places: np.ndarray, width: float = WIDTH, length: float = LENGTH) -> tuple[np.ndarray, np.ndarray]:
    """Points and outward normals of the outline, places from 0 to 1 around it."""
    r, side = width / 2, length - width
    s = places * (2.0 * side + 2.0 * np.pi * r)
    first, second = (s - side) / r, (s - 2.0 * side - np.pi * r) / r
    turn = np.select(
        [s < side, s < side + np.pi * r, s < 2.0 * side + np.pi * r],
        [np.pi / 2, np.pi / 2 - first, -np.pi / 2],
        -np.pi / 2 - second,
    )
    along = np.select(
        [s < side, s < side + np.pi * r, s < 2.0 * side + np.pi * r],
        [s - side / 2, side / 2, side / 2 - (s - side - np.pi * r)],
        -side / 2,
    )
    normals = np.column_stack([np.cos(turn), np.sin(turn)])
    return np.column_stack([along, np.zeros_like(along)]) + r * normals, normals


def wall(count: int, seed: int, noise: float = 0.0, **size: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    flat, normals = outline(rng.uniform(0.0, 1.0, count), **size)
    flat = flat + noise * rng.normal(size=(count, 1)) * normals
    return np.column_stack([flat, rng.uniform(0.0, DEPTH, count)]), np.column_stack([normals, np.zeros(count)])


def test_slopes_are_those_of_finite_differences() -> None:
    rng = np.random.default_rng(0)
    shape = Shape(rng.normal(size=3), frame_along(rng.normal(size=3)), 1.3, 0.0, 2.1)
    points, h = 3.0 * rng.normal(size=(40, 3)), 1e-6
    _, slopes = distances("slot", shape, points)
    for k, unit in enumerate(np.eye(7)):
        ahead, behind = (distances("slot", shape.moved("slot", s * h * unit), points)[0] for s in (1.0, -1.0))
        np.testing.assert_allclose((ahead - behind) / (2 * h), slopes[:, k], atol=1e-8)


@pytest.mark.parametrize("known", [True, False])
def test_exact_walls_give_the_slot_back_anywhere(known: bool) -> None:
    T = pose.random(np.random.default_rng(1), reach=100.0)
    points, normals = wall(300, 2)
    found = fit_feature(pose.apply(T, points), "slot", normals=pose.rotate(T, normals) if known else None)
    assert found.width == pytest.approx(WIDTH, abs=1e-12 * 100.0)
    assert found.length == pytest.approx(LENGTH, abs=1e-12 * 100.0)
    assert np.linalg.norm(pose.apply(pose.inverse(T), found.point)[:2]) < 1e-12 * 100.0
    assert abs(abs(found.frame[:, 0] @ T[:3, 0]) - 1.0) < 1e-12


def test_the_covariance_is_that_of_repeated_scans_and_the_zone_is_narrower() -> None:
    pulls = []
    for seed in range(60):
        points, normals = wall(150, seed, 0.01)
        found = fit_feature(points, "slot", normals=normals)
        half = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0])
        pulls.append([(found.width - WIDTH) / 2 / found.sigma("radius"),
                      (found.length - LENGTH) / 2 / np.sqrt(half @ found.covariance @ half)])  # fmt: skip
    # The standard deviation of 60 values scatters by 9 %.
    np.testing.assert_allclose(np.std(pulls, axis=0), 1.0, atol=0.3)
    assert fit_feature(points, "slot", normals=normals, method="chebyshev").form < found.form


def slotted() -> Mesh:
    """The wall of a slot as a strip of triangles, its normals towards the empty inside."""
    count = 192
    flat, _ = outline((np.arange(count) + 0.5) / count)
    low, high = np.column_stack([flat, np.zeros(count)]), np.column_stack([flat, np.full(count, DEPTH)])
    k = np.arange(count)
    beside = (k + 1) % count
    faces = np.concatenate(
        [np.column_stack([k, beside, k + count]), np.column_stack([beside, beside + count, k + count])]
    )
    return Mesh(np.concatenate([low, high]), faces)


@pytest.mark.filterwarnings("ignore:.*open")
def test_a_plan_measures_a_slot_of_several_faces() -> None:
    part = slotted()
    faces = [face.number for face in part_faces(part)]
    points, _ = wall(4_000, 3, 0.005, width=WIDTH + 0.05, length=LENGTH + 0.08)
    points[:, 0] += 0.03
    scan = measure_deviations(points, part, MeshSurface(part), reach=2.0)
    rows = [
        {"name": kind, "kind": kind, "faces": faces, "tolerance": 0.2} for kind in ("width", "length", "slot-position")
    ]
    width, length, place = inspect(scan, plan_of({"characteristic": rows})).characteristics
    assert (width.nominal, length.nominal) == pytest.approx((WIDTH, LENGTH), abs=1e-3)
    for row, true in ((width, WIDTH + 0.05), (length, LENGTH + 0.08), (place, 0.06)):
        assert abs(row.value - true) <= row.uncertainty < 0.02, row
    box = [{"name": "w", "kind": "width", "faces": faces[:1], "tolerance": 0.2}]
    with pytest.raises(InputError, match="are not the wall of a slot"):
        inspect(scan, plan_of({"characteristic": box}))


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e9])
def test_a_slot_is_held_alike_in_any_unit(unit: float) -> None:
    points, normals = wall(300, 2, noise=1e-3)
    found = fit_feature(unit * points, "slot", normals=normals)
    assert found.width == pytest.approx(unit * fit_feature(points, "slot", normals=normals).width, rel=1e-9)
