from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg._arrays import bounds
from dqreg.geometry.morton import distinct_in_order, in_order, morton_codes, morton_order
from dqreg.geometry.moved_points import moved
from tests.strategies import FloatArray, floats, points


@st.composite
def copies(draw: st.DrawFn) -> FloatArray:
    """Draw clouds with copies in any order, also between points that only the last digits tell apart."""
    few = [0.0, 1.0, 1e-9, -1e-9, 3e-16, 1e3]
    coordinate = st.one_of(st.sampled_from(few), floats(-2.0, 2.0))
    places = draw(st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=6))
    return np.array(draw(st.lists(st.sampled_from(places), min_size=1, max_size=30)))


def interleaved(cell: FloatArray) -> int:
    """Morton code of a grid cell, one bit at a time."""
    code = 0
    for bit in range(21):
        for axis, number in enumerate(int(c) for c in cell):
            code |= (number >> bit & 1) << (3 * bit + 2 - axis)
    return code


@settings(deadline=None)
@given(points(min_size=1, max_size=40))
def test_an_order_is_a_permutation(cloud: FloatArray) -> None:
    assert sorted(morton_order(cloud).tolist()) == list(range(len(cloud)))


@settings(deadline=None)
@given(copies())
def test_every_place_appears_once_by_its_first_row(cloud: FloatArray) -> None:
    kept = distinct_in_order(cloud)
    _, first = np.unique(cloud + 0.0, axis=0, return_index=True)
    assert sorted(kept.tolist()) == sorted(first.tolist())


@settings(deadline=None)
@given(copies())
def test_points_that_are_moved_where_they_are_read_stand_as_if_they_had_been_before(cloud: FloatArray) -> None:
    move = np.array([0.1, 1.0, -2.0, 0.3])
    there = moved(cloud, move)
    order = distinct_in_order(cloud, bounds(there), move)
    np.testing.assert_array_equal(order, distinct_in_order(there))
    np.testing.assert_array_equal(in_order(cloud, order, move), there[order])


def test_copies_are_found_between_other_points_of_their_cell() -> None:
    cloud = np.array([[0.0, 0, 0], [1e-9, 0, 0], [0, 0, 0], [1, 1, 1], [1e-9, 0, 0], [-0.0, 0, 0]])
    assert sorted(distinct_in_order(cloud).tolist()) == [0, 1, 3]


@settings(deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 40))
def test_points_that_share_cells_stand_as_if_all_were_sorted_by_cell_and_coordinates(seed: int, places: int) -> None:
    # A far corner makes the cells so large that most points share one; some places come many times.
    rng = np.random.default_rng(seed)
    cloud = np.vstack([rng.integers(0, places, size=(60, 3)) * 1e-7, [[1.0, 1.0, 1.0]]])
    order = np.lexsort((*cloud.T, morton_codes(cloud)))
    walked = cloud[order]
    expected = order[np.r_[True, (walked[1:] != walked[:-1]).any(axis=1)]]
    np.testing.assert_array_equal(distinct_in_order(cloud), expected)


def test_codes_ascend_as_if_their_bits_were_set_one_by_one() -> None:
    # Whole numbers up to the last cell are their own cells.
    rng = np.random.default_rng(0)
    cloud = rng.integers(0, 2**21, size=(500, 3)).astype(float)
    cloud[:2] = [[0, 0, 0], [2**21 - 1] * 3]
    codes = [interleaved(cell) for cell in cloud[morton_order(cloud)]]
    assert codes == sorted(codes)


def test_equal_points_keep_their_order() -> None:
    assert morton_order(np.zeros((5, 3))).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("scale", "origin"), [(1.0, 0.0), (1e-6, 0.0), (1e6, -3e5), (1.0, 5e6)])
def test_neighbours_in_the_walk_are_near(scale: float, origin: float) -> None:
    cloud = np.random.default_rng(0).uniform(size=(4_096, 3)) * scale + origin
    steps = np.linalg.norm(np.diff(cloud[morton_order(cloud)], axis=0), axis=1) / scale
    # In a Z-order walk half of all steps stay within a pair of cells; the cells' side is 1/16 at this count.
    assert np.median(steps) < 2.0 / 16.0
    # A walk in random order takes 0.66 a step.
    assert steps.mean() < 0.15


def test_the_order_depends_on_the_shape_alone() -> None:
    # Quarters and powers of two move nothing by rounding.
    cloud = np.random.default_rng(0).integers(0, 64, size=(300, 3)) / 4.0
    np.testing.assert_array_equal(morton_order(cloud), morton_order(8.0 * cloud + 1024.0))


def test_points_in_an_order_are_those_of_its_rows() -> None:
    rng = np.random.default_rng(0)
    points, order = rng.normal(size=(150_000, 3)), rng.permutation(150_000)[:140_000]
    np.testing.assert_array_equal(in_order(points, order), points[order])
    assert in_order(points, order[:0]).shape == (0, 3)
