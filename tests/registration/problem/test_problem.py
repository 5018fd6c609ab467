from __future__ import annotations

import dataclasses
import threading

import numpy as np
import pytest
from hypothesis import given, settings

import dqreg
from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.geometry import CloudSurface, Mesh, PointCloud
from dqreg.registration.problem import target_index
from dqreg.registration.problem.preparation import Prepared
from dqreg.registration.problem.problem import SourceAndTarget, as_viewpoints
from dqreg.registration.problem.source import CentredSource, centre_source
from dqreg.registration.problem.target_index import TargetIndex, index_target
from dqreg.registration.target import prepare_target
from dqreg.rigid import pose
from dqreg.synth.parts import bracket
from tests.registration.scenes import problem_of
from tests.strategies import poses, translations

SHEET = np.column_stack([np.random.default_rng(0).uniform(-1.0, 1.0, size=(40_000, 2)), np.zeros(40_000)])


def source(points: np.ndarray) -> CentredSource:
    return centre_source(points, None, None, np.random.default_rng(0))


def target(points: np.ndarray) -> TargetIndex:
    return index_target(points)


def downsampled(points: np.ndarray, stands: TargetIndex) -> Prepared:
    return Prepared.downsampled(source(points).cloud, stands, 1_000)


@settings(deadline=None, max_examples=100)
@given(poses(), translations(), translations())
def test_a_pose_between_the_centred_frames_is_the_same_motion(
    T: FloatArray, origin_target: FloatArray, origin_source: FloatArray
) -> None:
    cloud = PointCloud(np.eye(3))
    sides = SourceAndTarget(CentredSource(cloud, origin_source, 1.0), TargetIndex(cloud, origin_target))
    centred = sides.to_centred(T)
    size = 1.0 + np.abs(T[:3, 3]).max() + np.abs(origin_target).max() + np.abs(origin_source).max()
    point = np.array([1.0, -2.0, 3.0])
    # A source point, by the caller's frames and by the centred ones.
    np.testing.assert_allclose(
        pose.apply(centred, point - origin_source) + origin_target, pose.apply(T, point), atol=1e-14 * size, rtol=0.0
    )
    np.testing.assert_allclose(sides.to_caller(centred), T, atol=1e-14 * size, rtol=0.0)


def test_points_are_placed_in_the_centred_target_frame() -> None:
    T = pose.from_parts(np.eye(3), [3.0, 0.0, 0.0])
    problem = problem_of(SHEET[:500] + 7.0, Mesh(*bracket()), T, units="ignore")
    # The caller's own frames are the truth.
    expected = pose.apply(T, SHEET[:500] + 7.0) - problem.target.origin
    np.testing.assert_allclose(problem.placed(T), expected, atol=1e-12)


def test_a_viewpoint_is_a_place_or_one_of_two_words() -> None:
    origin = as_viewpoints("origin")
    assert origin is not None
    np.testing.assert_array_equal(origin, np.zeros((1, 3)))
    assert as_viewpoints("none") is None
    with pytest.raises(InputError, match='a place, "origin" or "none"; got \'here\''):
        as_viewpoints("here")


def test_dense_clouds_become_equal_cells_with_a_plane_at_each() -> None:
    sides = downsampled(SHEET, target(SHEET))
    assert 800 <= len(sides.scan) <= 1_250
    assert sides.scan.directed.all()
    assert sides.scan.total == 40_000
    # A sheet of two by two in a thousand squares.
    assert sides.cell_size == pytest.approx(2.0 / np.sqrt(1_000), rel=0.1)
    assert isinstance(sides.surface, CloudSurface)
    # As many as a grid of such cells has that the sheet meets, wherever it begins.
    across = np.ceil(2.0 / sides.cell_size)
    assert across**2 <= len(sides.surface.normals) <= (across + 1.0) ** 2


def test_sparse_clouds_and_meshes_stay_whole() -> None:
    few = SHEET[:1_500]
    stands = target(few)
    sides = downsampled(few, stands)
    assert sides.cell_size == 0.0
    assert len(sides.scan) == 1_500
    assert sides.surface is stands.surface
    with pytest.raises(InputError, match="mesh"):
        downsampled(few, index_target(Mesh(*bracket())))


def test_an_even_target_of_a_few_points_a_cell_has_cells_only_for_a_source_that_has_them() -> None:
    stands = target(SHEET[:2_900])
    for _ in range(2):
        assert downsampled(SHEET[:1_500], stands).cell_size == 0.0
        assert downsampled(SHEET[:2_500], stands).cell_size > 0.0


def test_the_loop_after_a_search_compares_what_it_would_after_an_initial_pose() -> None:
    searched, given = (problem_of(SHEET, SHEET, start) for start in (None, np.eye(4)))
    whole = searched.prepare()
    # A search sees all points.
    assert (whole.cell_size, len(whole.scan)) == (0.0, len(SHEET))
    found, expected = searched.prepare_found(whole), given.prepare()
    assert found.cell_size == expected.cell_size > 0.0
    np.testing.assert_array_equal(found.scan.points, expected.scan.points)
    np.testing.assert_array_equal(found.surface.normals, expected.surface.normals)
    assert given.prepare_found(expected) is expected
    # On a part there are no cells.
    part = problem_of(SHEET, Mesh(*bracket()), units="ignore")
    prepared = part.prepare()
    assert part.prepare_found(prepared) is prepared


def test_a_small_source_asks_for_cells_of_its_own_size() -> None:
    # A thousandth of the target's area: cells of the target would leave it one point.
    piece = SHEET[(np.abs(SHEET[:, :2]) < 0.1).all(axis=1)]
    sides = downsampled(piece, target(SHEET))
    assert len(sides.scan) >= len(piece) / 2
    dense = np.column_stack([np.random.default_rng(1).uniform(-0.1, 0.1, size=(30_000, 2)), np.zeros(30_000)])
    sides = downsampled(dense, target(SHEET))
    assert 500 <= len(sides.scan) <= 1_500


def test_a_dense_source_is_thinned_though_its_target_is_sparse() -> None:
    stands = target(SHEET[:1_500])
    sides = downsampled(SHEET, stands)
    assert 800 <= len(sides.scan) <= 1_250
    assert sides.surface is stands.surface


@pytest.mark.parametrize("verdict", [True, False])
def test_arrays_that_were_given_may_be_filled_again_once_there_is_a_result(verdict: bool) -> None:
    # So rough that cells say what all points do, and these are not asked for.
    corner = np.vstack([np.roll(SHEET[k::3], k, axis=1) for k in range(3)])
    rough = [corner + np.random.default_rng(seed).normal(scale=0.02, size=SHEET.shape) for seed in (1, 2)]
    arrays = [each.copy() for each in rough]
    result = dqreg.register(*arrays, "identity", effort="fast", verdict=verdict)
    attached = dataclasses.replace(result, inputs=None).attached(*arrays)
    prepared = prepare_target(arrays[1])
    for array in arrays:
        array[:] = 7.0
    moves, stands = (source(each).cloud.points for each in rough)
    for inputs in (result.inputs, attached.inputs):
        np.testing.assert_array_equal(inputs.source.cloud.points, moves)
        np.testing.assert_array_equal(inputs.target.geometry.points, stands)
    np.testing.assert_array_equal(prepared.indexed.geometry.points, stands)


def test_the_cells_of_a_target_are_built_once() -> None:
    stands = target(SHEET)
    assert stands.evened(1_000) is stands.evened(1_000)
    assert downsampled(SHEET, stands).surface is stands.evened(1_000).surface


def test_best_takes_all_points_of_a_body_and_cells_of_what_a_sensor_saw_from_its_stand() -> None:
    # A sensor above the sheet sees as many points in each ring about it as in any other.
    rng = np.random.default_rng(1)
    ways, angles = np.geomspace(0.005, 1.0, 40_000), rng.uniform(0.0, 2.0 * np.pi, 40_000)
    crowded = np.column_stack([ways * np.cos(angles), ways * np.sin(angles), 0.05 * rng.normal(size=40_000) * ways])
    for points, is_whole in ((SHEET, True), (crowded, False)):
        problem = problem_of(points, points, np.eye(4), effort="best")
        prepared = problem.prepare()
        assert prepared.is_whole == is_whole
        assert (prepared.cell_size == 0.0) == is_whole
        assert prepared.is_from_a_stand == (not is_whole)


def test_a_time_limit_takes_points_with_their_times() -> None:
    cloud = PointCloud(SHEET, times=SHEET[:, 0])
    some = problem_of(cloud, bracket(), np.eye(4), time_limit=0.02)._in_time
    assert len(some) == 20_000
    np.testing.assert_allclose(np.ptp(some.times - some.points[:, 0]), 0.0, atol=1e-12)


def test_a_time_limit_takes_points_of_a_target_that_is_not_prepared_and_shows_all() -> None:
    cloud = PointCloud(SHEET + np.array([5.0, 0.0, 0.0]))
    some, prepared = (problem_of(SHEET, each, np.eye(4), time_limit=0.02) for each in (cloud, prepare_target(cloud)))
    assert len(some.target.geometry) == 20_000
    np.testing.assert_array_equal(some.target.origin, some.whole.origin)
    assert len(some.whole.geometry) == len(prepared.target.geometry) == len(SHEET)
    result = dqreg.register(SHEET, cloud, np.eye(4), time_limit=0.02)
    assert result.inputs is not None
    assert len(result.inputs.target.geometry) == len(SHEET)


def test_no_more_of_a_mesh_is_waited_for_than_there_is_time(monkeypatch: pytest.MonkeyPatch) -> None:
    goes_on, ended = threading.Event(), []

    def slow(*_: object) -> FloatArray:
        goes_on.wait(300.0)
        ended.append("near symmetries")
        return np.zeros((0, 4, 4))

    monkeypatch.setattr(target_index, "near_flips", slow)
    result = dqreg.register(SHEET[:2_000], bracket(), np.eye(4), time_limit=1e-6, units="ignore")
    assert result.status == "time limit"
    assert not ended
    goes_on.set()
