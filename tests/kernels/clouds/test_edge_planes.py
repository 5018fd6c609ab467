"""Planes by an edge, beside their plain twins: every plane alone, every place alone."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.clouds.edge_planes import edge_plane_rows, with_others_rows

NEAREST, SINE, WITHIN, ROUNDS, FEWEST = 8, 0.4, 0.03, 3, 6


def found_at(points: FloatArray, neighbours: IntArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    total = len(neighbours)
    normals, residuals, found = np.zeros((total, 3)), np.zeros(total), np.zeros(total, dtype=bool)
    limits = NEAREST, SINE, WITHIN, ROUNDS, FEWEST
    edge_plane_rows(0, total, points, neighbours, *limits, normals, residuals, found)
    return normals, residuals, found


def plain(arms: FloatArray) -> tuple[FloatArray, float, bool]:
    """The plain twin, of neighbours from the point, (k, 3)."""
    best, held = np.inf, np.zeros(len(arms), dtype=bool)
    for p, q in itertools.combinations(range(1, min(NEAREST + 1, len(arms))), 2):
        normal = np.cross(arms[p], arms[q])
        area = np.linalg.norm(normal)
        if area > SINE * np.linalg.norm(arms[p]) * np.linalg.norm(arms[q]):
            aside = np.abs(arms @ normal) / area
            cost = (np.minimum(aside, WITHIN) ** 2).sum()
            if cost < best:
                best, held = cost, aside <= WITHIN
    values, axes = np.zeros(3), np.eye(3)
    for left in range(ROUNDS)[::-1]:
        middle = arms[held].mean(axis=0) if held.any() else np.zeros(3)
        values, axes = np.linalg.eigh((arms[held] - middle).T @ (arms[held] - middle))
        if left:
            held = np.abs((arms - middle) @ axes[:, 0]) <= WITHIN
    kept = int(np.count_nonzero(held))
    return axes[:, 0], float(np.sqrt(max(values[0], 0.0) / max(kept - 3, 1))), bool(kept >= FEWEST and held[0])


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, 5))])
def test_planes_by_an_edge_are_those_of_the_plain_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(240, 3))
    # Two faces that meet, and strays.
    points[:100, 2] = 0.01 * rng.normal(size=100)
    points[100:200, 0] = 0.01 * rng.normal(size=100)
    neighbours = np.argsort(np.linalg.norm(points - points[:, None], axis=2), axis=1)[:, :16].copy()
    normals, residuals, found = found_at(points, neighbours)
    for i, rows in enumerate(neighbours):
        normal, residual, is_any = plain(points[rows] - points[i])
        assert found[i] == is_any
        if is_any:
            assert abs(normal @ normals[i]) > 1.0 - 1e-9
            assert residuals[i] == pytest.approx(residual, rel=1e-6)
    assert 100 < np.count_nonzero(found) < 240


def test_neighbours_on_a_line_make_no_plane() -> None:
    line = np.outer(np.arange(24.0), [1.0, 2.0, 3.0])
    assert not found_at(line, np.arange(24)[None])[2][0]


def test_places_have_others_on_their_face_as_counted_one_by_one() -> None:
    rng = np.random.default_rng(1)
    points, normals = rng.uniform(size=(300, 3)), rng.normal(size=(300, 3))
    normals[:200] = [0.0, 0.0, 1.0]
    points[:200, 2] *= 0.1
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    asked, found = np.arange(150, 300), np.zeros(150, dtype=bool)
    with_others_rows(0, 150, asked, points, normals, 0.01, 0.03, 0.99, 4, found)
    for row, one in zip(asked, found, strict=True):
        arms = points - points[row]
        on = np.abs(arms @ normals[row]) < 0.01 + 0.03 * np.linalg.norm(arms, axis=1)
        assert one == (np.count_nonzero(on & (np.abs(normals @ normals[row]) > 0.99)) > 4)
    assert found.any()
    assert not found.all()
