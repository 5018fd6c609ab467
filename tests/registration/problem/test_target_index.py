from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg._records import remembered
from dqreg.errors import DegenerateGeometryError, InputError, UnitsError
from dqreg.geometry import CloudSurface, Mesh, MeshSurface, PointCloud
from dqreg.geometry.opening import as_geometry
from dqreg.kernels import kept, threads
from dqreg.registration.problem.source import MESH_SAMPLES, centre_source, require_spread
from dqreg.registration.problem.target_index import index_target
from dqreg.synth.parts import box
from tests.strategies import FloatArray

VERTICES, FACES = box((3.0, 2.0, 1.0))
CLOUD = np.random.default_rng(0).integers(0, 1_024, size=(300, 3)) / 64.0
FAR = np.array([5e6, -4e6, 2e5])
RNG = np.random.default_rng(0)


def centred(source: Any, source_units: str | None = None, target_units: str | None = None) -> Any:
    return centre_source(source, source_units, target_units, np.random.default_rng(0))


@pytest.mark.parametrize("make", [PointCloud, lambda points: Mesh(points, FACES)])
def test_a_target_far_away_is_indexed_as_the_same_one_at_home(make: Any) -> None:
    # Multiples of 1/64 stay exact at 5e6: not one bit may differ.
    points = VERTICES if make is not PointCloud else CLOUD
    home, away = index_target(make(points)), index_target(make(points + FAR))
    np.testing.assert_array_equal(away.origin - home.origin, FAR)
    names = ("points",) if make is PointCloud else ("vertices", "faces")
    for name in names:
        np.testing.assert_array_equal(getattr(home.geometry, name), getattr(away.geometry, name))
    np.testing.assert_array_equal(home.surface.centre, np.zeros(3))
    queries = np.random.default_rng(1).normal(size=(50, 3))
    np.testing.assert_array_equal(home.surface.closest(queries).points, away.surface.closest(queries).points)


def test_a_source_far_away_is_centred_as_the_same_one_at_home() -> None:
    viewpoint = np.array([1.0, 2.0, 3.0])
    home, away = (
        centred(PointCloud(CLOUD, viewpoint=viewpoint)),
        centred(PointCloud(CLOUD + FAR, viewpoint=viewpoint + FAR)),
    )
    np.testing.assert_array_equal(away.origin - home.origin, FAR)
    np.testing.assert_array_equal(home.cloud.points, away.cloud.points)
    np.testing.assert_array_equal(home.cloud.viewpoint, away.cloud.viewpoint)
    np.testing.assert_array_equal(home.cloud.points + home.origin, CLOUD)


@pytest.mark.parametrize(
    ("own", "source_units", "target_units", "scale"),
    [
        (None, "m", "mm", 1e3),
        ("m", None, "mm", 1e3),
        ("m", "inch", "mm", 25.4),
        (None, None, "mm", 1.0),
        ("m", None, None, 1.0),
        ("mm", "mm", "mm", 1.0),
    ],
)
def test_a_source_is_converted_where_both_units_are_known_and_named_ones_win(
    own: str | None, source_units: str | None, target_units: str | None, scale: float
) -> None:
    cloud = PointCloud(CLOUD, np.tile([0.0, 0, 1], (300, 1)), viewpoint=[1.0, 2.0, 3.0], units=own, dropped=4)
    source = centred(cloud, source_units, target_units)
    assert source.scale == scale
    rounding = 4.0 * np.finfo(float).eps * scale * np.abs(CLOUD).max()
    np.testing.assert_allclose(source.cloud.points + source.origin, scale * CLOUD, rtol=0, atol=rounding)
    np.testing.assert_allclose(source.cloud.viewpoint + source.origin, scale * np.array([1.0, 2, 3]), atol=rounding)
    np.testing.assert_array_equal(source.cloud.normals, cloud.normals)
    assert source.cloud.dropped == 4
    low, high = source.cloud.points.min(axis=0), source.cloud.points.max(axis=0)
    np.testing.assert_allclose(low + high, 0.0, atol=4.0 * rounding)


def test_an_unknown_unit_is_refused() -> None:
    with pytest.raises(UnitsError, match="unknown length unit 'furlong'"):
        centred(CLOUD, "furlong", "mm")


LINE = np.outer(np.arange(20.0), [1.0, 2.0, -1.0])


@pytest.mark.parametrize("origin", [0.0, 5e6])
@pytest.mark.parametrize("turn", [np.eye(3), np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]])
def test_points_on_a_line_are_refused_on_both_sides(origin: float, turn: FloatArray) -> None:
    line = LINE @ turn.T + origin
    with pytest.raises(DegenerateGeometryError, match="all 20 points of the source lie on one line"):
        centred(line)
    with pytest.raises(DegenerateGeometryError, match="all 20 points of the target lie on one line"):
        index_target(line)


def test_points_at_one_place_are_on_a_line_too() -> None:
    with pytest.raises(DegenerateGeometryError, match="all 6 points"):
        index_target(np.ones((6, 3)))


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_narrow_strip_is_no_line(scale: float) -> None:
    strip = LINE.copy()
    strip[::2] += 1e-7 * np.array([2.0, -1.0, 0.0])
    with pytest.raises(DegenerateGeometryError):
        require_spread(scale * LINE, "line")
    require_spread(scale * strip, "strip")  # a ten-millionth as wide as long: no error
    require_spread(scale * np.repeat(np.eye(3), 2, axis=0), "triangle")


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.eye(3), np.eye(6)[:5, :3], [*np.eye(5, 3), [np.nan, 1, 0]]])
def test_fewer_usable_points_than_a_pose_needs_are_refused(points: Any) -> None:
    with pytest.raises(InputError, match=r"target has \d usable points?; at least six"):
        index_target(points)
    with pytest.raises(InputError, match=r"source has \d usable points?; at least six"):
        centred(points)


def test_a_mesh_that_is_the_source_is_sampled_the_same_way_each_time() -> None:
    source, again = centred(Mesh(VERTICES, FACES, "m"), None, "mm"), centred(Mesh(VERTICES, FACES, "m"), None, "mm")
    assert (len(source.cloud), source.scale) == (MESH_SAMPLES, 1e3)
    np.testing.assert_array_equal(source.cloud.points, again.cloud.points)
    assert source.cloud.normals is not None


def test_what_a_target_is_and_what_it_lost() -> None:
    mesh = index_target(Mesh(VERTICES, [*FACES.tolist(), [0, 0, 1]], "mm"))
    assert (mesh.kind, mesh.units, mesh.geometry.dropped) == ("mesh", "mm", 1)
    assert isinstance(mesh.surface, MeshSurface)
    cloud = index_target([*CLOUD.tolist(), [np.nan, 0, 0]])
    assert (cloud.kind, cloud.units, cloud.geometry.dropped) == ("cloud", None, 1)
    assert isinstance(cloud.surface, CloudSurface)


def test_threads_that_ask_first_get_one_surface() -> None:
    target = index_target(CLOUD)
    with ThreadPoolExecutor(4) as pool:
        surfaces = set(pool.map(lambda _: id(target.surface), range(16)))
    assert len(surfaces) == 1


def test_paths_are_read_and_named_in_messages(tmp_path: Path) -> None:
    path = tmp_path / "cloud.xyz"
    np.savetxt(path, CLOUD)
    for given in (path, str(path)):
        np.testing.assert_array_equal(as_geometry(given, "source").points, CLOUD)
    with pytest.raises(InputError, match=r"gone\.xyz"):
        as_geometry(tmp_path / "gone.xyz", "target")


def test_the_arrays_given_are_as_they_were() -> None:
    points = CLOUD.copy()
    index_target(points)
    centred(points, "m", "mm")
    np.testing.assert_array_equal(points, CLOUD)


def test_the_visible_faces_are_a_target_of_their_own_and_the_whole_stays_as_it_was() -> None:
    target = index_target(Mesh(VERTICES, FACES))
    above = target.visible_from(np.array([[0.0, 0.0, 10.0]]))
    assert above.visible is not None
    assert 0 < np.count_nonzero(above.visible) < len(FACES)
    # The lower face is hidden: what is below the box is closest to the upper one, or to an edge of it.
    below = np.array([[0.1, 0.2, -5.0]])
    assert above.surface.closest(below).points[0, 2] > target.surface.closest(below).points[0, 2]
    assert target.visible is None
    around = np.vstack([10.0 * np.eye(3), -10.0 * np.eye(3)])
    assert target.visible_from(around) is target
    # A cloud has no faces to hide.
    cloud = index_target(PointCloud(VERTICES))
    assert cloud.visible_from(np.array([[0.0, 0.0, 10.0]])) is cloud


def test_what_the_global_search_looks_up_is_built_once() -> None:
    target = index_target(Mesh(VERTICES, FACES)).build()
    assert target.pairs is target.pairs
    assert target.near_rotations is target.near_rotations
    assert index_target(CLOUD).near_rotations.shape == (0, 4, 4)
    assert index_target(target) is target


@pytest.mark.parametrize("count", [1, 2])
def test_near_symmetries_are_there_once_asked_for_and_go_along(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    # Found beside what follows; without another core at once.
    monkeypatch.setattr(threads, "thread_count", lambda: count)
    monkeypatch.setattr(kept, "thread_count", lambda: count)
    target = index_target(Mesh(VERTICES, FACES)).build()
    if count == 1:
        with threads.until(0.0):
            assert target.near_rotations.shape[1:] == (4, 4)
    again = pickle.loads(pickle.dumps(target))
    expected = index_target(Mesh(VERTICES, FACES)).near_rotations
    np.testing.assert_array_equal(vars(again)["near_rotations"], expected)
    np.testing.assert_array_equal(target.near_rotations, expected)
    assert expected.shape[1:] == (4, 4)


def test_near_symmetries_are_found_for_a_verdict_alone() -> None:
    index = index_target(Mesh(VERTICES, FACES))
    index.build_beside(judged=False).join()
    assert remembered(index, "surface") is not None
    assert remembered(index, "near_rotations") is None
    index.build_beside().join()
    assert remembered(index, "near_rotations") is not None
