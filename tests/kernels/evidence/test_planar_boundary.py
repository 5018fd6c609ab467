from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.evidence.planar_boundary import in_plane_sq_distances, interior_rows, near_fractions
from dqreg.trust.face_rims import OPEN_COS, OPEN_RAD, PLANE_NEIGHBOURS, open_sides

COUNT = PLANE_NEIGHBOURS + 1


def nearest(points: FloatArray, count: int) -> IntArray:
    """The nearest of all points, (n, count), the point itself the first."""
    squares = ((points[:, None] - points) ** 2).sum(axis=2)
    np.fill_diagonal(squares, -1.0)
    return np.argsort(squares, axis=1, kind="stable")[:, :count]


def sheet(seed: int, thick: float, share: float) -> tuple[FloatArray, IntArray]:
    """Points on a plane and off it, and those within a height of it, along a line more than across."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(120, 3)) * [2.0, 10.0 ** rng.uniform(-1.0, 0.3), 0.0]
    if seed % 3 == 0:
        # Whole numbers, none of them -0: points above each other, and angles that are met exactly.
        points = np.rint(2.0 * points) + 0.0
    points[:, 2] = rng.uniform(-thick, thick, 120)
    points[rng.random(120) > share, 2] += 2.5 * thick
    return points, np.flatnonzero(np.abs(points[:, 2]) <= thick)


def told(points: FloatArray, held: IntArray, table: IntArray, beside: int, thick: float) -> BoolArray:
    places, found = np.full(len(points), -1), np.zeros(len(held), dtype=bool)
    places[held] = np.arange(len(held))
    flat, asked = np.ascontiguousarray(points[held, :2]), np.arange(len(held))
    given = asked, flat, held, places, points, held, table.astype(np.int32)
    interior_rows(0, len(held), *given, beside, COUNT, 2.0 * thick, OPEN_COS, found)
    return found


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(2, 30), st.sampled_from([1e-6, 0.02, 0.3, 3.0]), st.floats(0.3, 1.0))
def test_the_nearest_in_the_plane_leave_none_of_those_on_a_rim(
    seed: int, columns: int, thick: float, share: float
) -> None:
    points, held = sheet(seed, thick, share)
    found = told(points, held, nearest(points, columns), 0, thick)
    flat = points[held, :2]
    if found.any():
        open_rad = open_sides(flat, flat, nearest(np.column_stack([flat, np.zeros(len(flat))]), COUNT))[0]
        assert open_rad[found].max() <= OPEN_RAD


def test_few_points_amid_others_need_their_nearest_in_the_plane() -> None:
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-10.0, 10.0, (2_000, 2)), rng.uniform(-0.01, 0.01, 2_000)])
    inner = np.abs(points[:, :2]).max(axis=1) < 9.0
    found = told(points, np.arange(2_000), nearest(points, 24), 0, 0.01)
    assert found[inner].mean() > 0.99


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.floats(0.3, 1.0))
def test_neighbours_in_space_that_lie_in_the_plane_close_the_round(seed: int, columns: int, share: float) -> None:
    # So thick that nothing is certain of the nearest in the plane.
    points, held = sheet(seed, 1.0, share)
    table = nearest(points, columns)
    found = told(points, held, table, columns, 1e3)
    places = np.full(len(points), -1)
    places[held] = np.arange(len(held))
    flat = points[held, :2]
    for own, (row, line) in enumerate(zip(held, table[held], strict=True)):
        beside = [places[k] for k in line[1:] if places[k] >= 0]
        open_rad = open_sides(flat[own][None], flat, np.array([[own, *beside]]))[0][0] if beside else 7.0
        assert found[own] == (open_rad <= OPEN_RAD), row


def test_shares_are_those_of_the_neighbours_that_are_near() -> None:
    rng = np.random.default_rng(4)
    table, lines = rng.integers(0, 50, (30, 8)).astype(np.int32), rng.integers(0, 30, 40)
    near, shares = rng.random(50) < 0.5, np.zeros(40)
    for count in (3, 8, 20):
        near_fractions(0, 40, lines, table, count, near, shares)
        np.testing.assert_array_equal(shares, near[table[lines][:, :count]].mean(axis=1))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(0, 30))
def test_squares_are_those_in_the_plane_among_the_points_next_along_the_order(
    seed: int, window: int, last: int
) -> None:
    rng = np.random.default_rng(seed)
    points, rows, asked = rng.normal(size=(60, 3)), np.sort(rng.permutation(60)[:40]), rng.permutation(40)[:15]
    last, found = min(last, window - 1), np.zeros(15)
    in_plane_sq_distances(points, points[:, 2].copy(), rows, asked, window, last, found)
    for k, place in enumerate(asked):
        first = min(max(place - window // 2, 0), 40 - window)
        arms = points[rows[first : first + window], :2] - points[rows[place], :2]
        assert np.isclose(found[k], np.sort((arms**2).sum(axis=1))[last], rtol=1e-9, atol=1e-12)
