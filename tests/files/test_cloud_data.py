from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files.cloud_data import make_cloud

NAN, INF = np.nan, np.inf
POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [NAN, 0, 0], [3, 0, 0], [4, 0, -INF]])
UP = np.tile([0.0, 0.0, 1.0], (5, 1))


def test_rows_that_are_not_finite_go_with_their_normals() -> None:
    cloud = make_cloud(Path("a.ply"), POINTS, UP * [[1], [2], [3], [4], [5]])
    assert cloud.points[:, 0].tolist() == [0.0, 1.0, 3.0]
    assert cloud.normals is not None
    assert cloud.normals[:, 2].tolist() == [1.0, 2.0, 4.0]
    assert cloud.dropped == 2


@pytest.mark.parametrize("missing", [[NAN, NAN, NAN], [0.0, 0.0, 0.0], [0.0, INF, 0.0]])
def test_a_missing_normal_costs_its_point(missing: list[float]) -> None:
    normals = UP.copy()
    normals[1] = missing
    cloud = make_cloud(Path("a.pcd"), POINTS, normals)
    assert cloud.points[:, 0].tolist() == [0.0, 3.0]
    assert cloud.dropped == 3


@pytest.mark.parametrize("missing", [NAN, 0.0])
def test_normals_that_are_all_missing_were_never_there(missing: float) -> None:
    cloud = make_cloud(Path("a.pcd"), POINTS, np.full((5, 3), missing))
    assert cloud.normals is None
    assert cloud.points[:, 0].tolist() == [0.0, 1.0, 3.0]
    assert cloud.dropped == 2


def test_the_input_is_not_changed_and_the_result_is_frozen() -> None:
    given = POINTS.copy()
    cloud = make_cloud(Path("a.ply"), given)
    np.testing.assert_array_equal(given, POINTS)
    with pytest.raises(dataclasses.FrozenInstanceError):
        cloud.dropped = 0  # type: ignore[misc]


def test_a_large_finite_number_is_no_infinity() -> None:
    assert make_cloud(Path("a.ply"), np.full((3, 3), 1e308)).dropped == 0


@pytest.mark.parametrize(
    ("points", "message"),
    [(np.zeros((0, 3)), "no points"), (np.full((4, 3), NAN), "4 points, all NaN or infinite")],
)
def test_nothing_left_is_an_error(points: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_cloud(Path("a.ply"), points)
