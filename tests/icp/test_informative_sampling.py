from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.geometry import MeshSurface, PointCloud, prepare_scan
from dqreg.icp import find_correspondences
from dqreg.icp.informative_sampling import information_gain, sample_by_gain
from dqreg.solvers.quadratic import plane_rows
from tests.icp.scenes import bracket_mesh, bracket_points

PART = bracket_mesh()


def information(pairs, rows) -> np.ndarray:
    J = plane_rows(pairs.moved[rows], pairs.closest.normals[rows], np.zeros(3), 0.5 * PART.diagonal)
    return J @ J.T


def test_the_value_of_a_pair_is_what_one_more_like_it_would_gain() -> None:
    # The derivative of tr(M^-1) by a pair's weight, against a finite difference, up to the common factor.
    scan = prepare_scan(PointCloud(bracket_points(60, seed=0)))
    pairs = find_correspondences(scan, MeshSurface(PART), np.eye(4))
    weights = np.random.default_rng(0).uniform(0.2, 1.0, len(scan))
    values = information_gain(pairs, weights)
    centre = pairs.moved.mean(axis=0)
    lever = np.sqrt(((pairs.moved - centre) ** 2).sum(axis=1).mean())
    J = plane_rows(pairs.moved, pairs.closest.normals, centre, lever)
    M = (J * weights) @ J.T
    before = np.trace(np.linalg.inv(M))
    some = np.arange(0, len(scan), len(scan) // 20)
    step = 1e-3
    gains = [before - np.trace(np.linalg.inv(M + step * weights[i] * np.outer(J[:, i], J[:, i]))) for i in some]
    np.testing.assert_allclose(values[some] / values[some].sum(), np.array(gains) / sum(gains), rtol=1e-3)
    assert values.mean() == pytest.approx(1.0, rel=1e-12)


def test_favoured_points_hold_the_part_better_than_an_even_choice() -> None:
    scan = prepare_scan(PointCloud(bracket_points(300, seed=0)))
    pairs = find_correspondences(scan, MeshSurface(PART), np.eye(4))
    places = scan.even_rows(5_000)
    some = find_correspondences(scan.taken(places), MeshSurface(PART), np.eye(4))
    count = len(scan) // 5
    favoured = sample_by_gain(information_gain(some, np.ones(len(places))), places, len(scan), count)
    even = scan.even_rows(len(favoured))
    spread = [np.trace(np.linalg.inv(information(pairs, rows))) for rows in (favoured, even)]
    assert spread[0] < 0.8 * spread[1]


def test_a_small_feature_that_alone_fixes_a_turn_is_taken_whole() -> None:
    # A disc is free to turn but for a key: 200 of its 20,000 points stand against the turn.
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.uniform(-1, 1, (20_000, 2)), np.zeros(20_000)])
    scan = prepare_scan(PointCloud(flat))
    key = np.arange(9_000, 9_200)
    normals = np.tile([0.0, 0, 1], (20_000, 1))
    normals[key] = [0.6, 0.8, 0.0]
    pairs = find_correspondences(scan, MeshSurface(PART), np.eye(4))
    pairs = dataclasses.replace(pairs, closest=dataclasses.replace(pairs.closest, normals=normals))
    rows = sample_by_gain(information_gain(pairs, np.ones(20_000)), np.arange(20_000), 20_000, 2_000)
    assert np.isin(key, rows).mean() >= 0.9
    assert len(rows) == pytest.approx(2_000, rel=0.02)


@settings(deadline=None, max_examples=100)
@given(st.integers(1, 5_000), st.integers(1, 6_000), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1.0, 4.0]))
def test_rows_are_distinct_ascending_and_about_as_many_as_asked(total: int, count: int, seed: int, skew: float) -> None:
    rng = np.random.default_rng(seed)
    places = np.sort(rng.choice(total, rng.integers(1, total + 1), replace=False))
    rows = sample_by_gain(rng.exponential(size=len(places)) ** skew, places, total, count)
    assert (np.diff(rows) > 0).all()
    assert 0 <= rows[0] <= rows[-1] < total if len(rows) else count < 4
    # The even share comes on top where the favoured rows are full already.
    assert 0.25 * min(count, total) - 1 <= len(rows) <= min(count, total) + 1


def test_nothing_to_tell_is_an_even_choice() -> None:
    rows = sample_by_gain(np.ones(10), np.arange(0, 100, 10), 100, 20)
    assert len(rows) == 20
    assert np.diff(rows).max() <= 6
