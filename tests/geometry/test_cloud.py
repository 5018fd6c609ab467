from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import PointCloud
from dqreg.geometry.cells import Cells
from dqreg.geometry.voxels import cell_size

NAN, INF = float("nan"), float("inf")
TWO = [[0.0, 0, 0], [1, 0, 0]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": [0.0, 1, 2]}, r"points must have shape \(n, 3\).*got shape \(3,\)"),
        ({"points": [[0.0, 1]]}, r"got shape \(1, 2\)"),
        ({"points": np.zeros((2, 4))}, r"got shape \(2, 4\)"),
        ({"points": np.zeros((0, 3))}, "at least one finite point; it is empty"),
        ({"points": [[NAN, 0, 0], [0, INF, 0]]}, "all 2 rows hold NaN or infinity"),
        ({"points": "cloud"}, "points must be an array of real numbers; got str"),
        ({"points": [[1j, 0, 0]]}, "points must be an array of real numbers"),
        ({"points": None}, "points must be an array of real numbers; got NoneType"),
        ({"points": TWO, "normals": [[0.0, 0, 1]]}, "got 1 normals for 2 points"),
        ({"points": TWO, "normals": [0.0, 0, 1]}, r"normals must have shape \(n, 3\)"),
        (
            {"points": TWO, "normals": np.zeros((2, 3))},
            "normals of all 2 finite points are zero.*: leave the normals out",
        ),
        ({"points": TWO, "viewpoint": [0.0, 0]}, "viewpoint must be three finite numbers"),
        ({"points": TWO, "viewpoint": [0.0, NAN, 0]}, "viewpoint must be three finite numbers"),
    ],
)
def test_what_is_no_cloud_is_refused_in_words(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        PointCloud(**arguments)


def test_rows_that_are_not_finite_go_with_their_normals_and_are_counted() -> None:
    points = np.array([[0.0, 0, 0], [NAN, 0, 0], [1, 0, 0], [2, 0, 0], [3, INF, 0], [4, 0, 0]])
    normals = np.array([[0.0, 0, 2], [0, 0, 1], [0, 0, 0], [NAN, 0, 1], [0, 1, 0], [0, -3, 0]])
    cloud = PointCloud(points, normals, dropped=10)
    assert cloud.points.tolist() == [[0, 0, 0], [4, 0, 0]]
    assert cloud.normals is not None
    assert cloud.normals.tolist() == [[0, 0, 1], [0, -1, 0]]
    assert (len(cloud), cloud.dropped) == (2, 14)
    # Made once more, it loses nothing more.
    assert dataclasses.replace(cloud, units="mm").dropped == 14


def test_what_was_given_is_not_changed() -> None:
    points, normals = np.array([[NAN, 0, 0], [1.0, 0, 0]]), np.array([[0.0, 0, 2], [0, 0, 2]])
    before = points.copy(), normals.copy()
    PointCloud(points, normals)
    np.testing.assert_array_equal(points, before[0])
    np.testing.assert_array_equal(normals, before[1])


@pytest.mark.parametrize("dtype", [np.float32, np.int32, np.uint8, object])
def test_any_real_numbers_become_float64(dtype: Any) -> None:
    cloud = PointCloud(np.array([[1, 2, 3]], dtype=dtype))
    assert cloud.points.dtype == np.float64
    assert cloud.points.tolist() == [[1.0, 2.0, 3.0]]


def test_a_tiny_normal_is_a_direction_still() -> None:
    cloud = PointCloud([[0.0, 0, 0]], [[0.0, 3e-100, 4e-100]])
    assert cloud.normals is not None
    np.testing.assert_allclose(cloud.normals, [[0.0, 0.6, 0.8]], rtol=1e-12)


def test_times_go_with_their_points():
    cloud = PointCloud([[0, 0, 0], [np.nan, 0, 0], [1, 0, 0]], times=[1.0, 2.0, 3.0])
    assert cloud.times.tolist() == [1.0, 3.0]
    with pytest.raises(InputError, match=r"times must be one number per point; got shape \(2,\) for 3 points"):
        PointCloud(np.eye(3), times=[1.0, 2.0])


def known_cloud(count: int = 700) -> PointCloud:
    """A cloud of which all is known that can be; normals and times tell their points."""
    points = np.random.default_rng(4).normal(size=(count, 3))
    return PointCloud(points, points[:, ::-1], [9.0, 8.0, 7.0], "mm", 5, points[:, 0])


@pytest.mark.parametrize("as_mask", [False, True])
def test_rows_of_a_cloud_take_along_all_that_is_known_of_them(as_mask: bool) -> None:
    cloud = known_cloud()
    rows = np.flatnonzero(cloud.points[:, 1] > 0.3)
    some = cloud._taken(cloud.points[:, 1] > 0.3 if as_mask else rows)
    assert len(some) == len(rows) < len(cloud)
    for name in ("points", "normals", "times"):
        np.testing.assert_array_equal(getattr(some, name), getattr(cloud, name)[rows])
    assert (some.units, some.dropped, some.viewpoint is cloud.viewpoint) == ("mm", 5, True)
    # The ends are those of the rows, not of the whole.
    np.testing.assert_array_equal(some._ends, PointCloud(cloud.points[rows])._ends)
    # A field that is new is carried too, or this list and `_taken` are told of it.
    assert {field.name for field in dataclasses.fields(PointCloud)} == {
        *("points", "normals", "times", "viewpoint", "units", "dropped")
    }


def test_rows_of_a_bare_cloud_are_bare() -> None:
    some = PointCloud(np.eye(3))._taken(np.array([2, 0]))
    assert some.points.tolist() == [[0, 0, 1], [1, 0, 0]]
    assert (some.normals, some.times, some.viewpoint, some.units) == (None, None, None, None)


def test_points_that_stand_for_others_have_no_times() -> None:
    cloud = known_cloud()
    means = cloud._standing_for(cloud.points.reshape(-1, 7, 3).mean(axis=1), None)
    assert (len(means), means.times, means.normals) == (100, None, None)
    assert (means.units, means.dropped, means.viewpoint.tolist()) == ("mm", 5, [9.0, 8.0, 7.0])


@pytest.mark.parametrize("scale", [1.0, 0.0254])
def test_a_moved_cloud_is_the_one_of_the_moved_points(scale: float) -> None:
    rng = np.random.default_rng(3)
    cloud = PointCloud(rng.normal(size=(700, 3)), viewpoint=np.array([0.0, 1.0, 2.0]), times=np.arange(700.0))
    offset = np.array([1e3, -1e-3, 0.7])
    found, made = cloud._moved(offset, scale), PointCloud(scale * cloud.points + offset)
    rows, cells = np.array([5, 3, 600]), (Cells.of(found, 0.3), Cells.of(made, 0.3))
    np.testing.assert_array_equal(found._at(rows), made.points[rows])
    for name in ("codes", "counts", "points", "scatters"):
        np.testing.assert_array_equal(*(getattr(each, name) for each in cells))
    assert cell_size(found, 70) == cell_size(made, 70)
    # Nothing of this asks for all points, which none has moved by now.
    assert "points" not in vars(found)
    assert len(found) == 700
    np.testing.assert_array_equal(found.points, made.points)
    # Rounding keeps the order of numbers, so the ends are those of the moved points to the bit.
    np.testing.assert_array_equal(found._ends, made._ends)
    np.testing.assert_array_equal(found.viewpoint, scale * np.array([0.0, 1.0, 2.0]) + offset)
    assert found.times is cloud.times
    with pytest.raises(InputError, match="beyond 1e\\+60"):
        cloud._moved(np.zeros(3), 1e61)
