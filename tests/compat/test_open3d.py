from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg._open3d import load_open3d
from dqreg.compat import open3d as ours
from dqreg.errors import InputError
from dqreg.geometry import Mesh, PointCloud
from dqreg.rigid import pose, twist
from dqreg.synth.parts import bracket

o3d = load_open3d()
theirs = o3d.pipelines.registration


def cloud(points, normals=None):
    result = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is not None:
        result.normals = o3d.utility.Vector3dVector(normals)
    return result


def pair(seed: int, count: int = 400):
    # A wavy sheet seen twice, the second time moved a little: true pose T.
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-1, 1, (2, count, 2))
    sheets = np.dstack([xy, 0.3 * np.sin(3 * xy[..., :1]) * np.cos(2 * xy[..., 1:])])
    T = twist.exp(rng.normal(scale=0.02, size=6))
    return pose.apply(pose.inverse(T), sheets[0]), sheets[1], T


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**31), st.floats(0.05, 0.5))
def test_point_to_point_gives_open3ds_pose_and_figures(seed, reach):
    source, target, _ = pair(seed)
    expected = theirs.registration_icp(cloud(source), cloud(target), reach)
    found = ours.registration_icp(cloud(source), cloud(target), reach)
    np.testing.assert_allclose(found.transformation, expected.transformation, atol=1e-9)
    assert found.fitness == expected.fitness
    assert found.inlier_rmse == pytest.approx(expected.inlier_rmse, abs=1e-12)

    def pairs(r):
        return {tuple(row) for row in np.asarray(r.correspondence_set).tolist()}

    assert pairs(found) == pairs(expected)


METHODS = [
    ours.TransformationEstimationPointToPoint(),
    ours.TransformationEstimationPointToPlane(),
    ours.TransformationEstimationDualQuaternion(),
    ours.TransformationEstimationDualQuaternionNormals(),
    theirs.TransformationEstimationPointToPoint(),
    theirs.TransformationEstimationPointToPlane(),
]


@pytest.mark.parametrize("method", METHODS, ids=lambda m: f"{type(m).__module__.split('.')[0]}-{type(m).__name__}")
def test_figures_are_those_of_evaluate_registration_at_the_same_pose(method):
    source, target, T = pair(7, 2000)
    found = ours.registration_icp(cloud(source), cloud(target), 0.2, np.eye(4), method, theirs.ICPConvergenceCriteria())
    for module in (theirs, ours):
        again = module.evaluate_registration(cloud(source), cloud(target), 0.2, found.transformation)
        assert found.fitness == again.fitness
        assert found.inlier_rmse == pytest.approx(again.inlier_rmse, rel=1e-9)
        assert len(found.correspondence_set) == len(again.correspondence_set)
    # Points are 0.04 apart: plane steps come within a tenth of that, point steps within half.
    assert pose.offset_between(found.transformation, T) < 0.02


def test_given_normals_and_tensor_clouds_are_used():
    source, target, _ = pair(1)
    legacy = cloud(target)
    legacy.estimate_normals()
    tensor = o3d.t.geometry.PointCloud.from_legacy(legacy)
    method = ours.TransformationEstimationPointToPlane()
    a, b = (ours.registration_icp(source, t, 0.3, None, method) for t in (legacy, tensor))
    # Tensor clouds made from legacy ones hold float32.
    np.testing.assert_allclose(a.transformation, b.transformation, atol=1e-5)


def test_rows_count_as_in_the_callers_cloud_where_some_are_not_finite():
    target = np.random.default_rng(0).uniform(size=(50, 3))
    source = target.copy()
    source[[3, 10]] = np.nan
    found = ours.evaluate_registration(source, target, 1e-6)
    assert found.fitness == 48 / 50
    np.testing.assert_array_equal(found.correspondence_set[:, 0], found.correspondence_set[:, 1])
    assert 3 not in found.correspondence_set[:, 0]


def test_copies_of_points_count_as_in_open3d():
    target = np.random.default_rng(0).uniform(size=(60, 3))
    source = np.vstack([target, target[:20]]) + 0.001
    expected = theirs.registration_icp(cloud(source), cloud(np.vstack([target, target])), 0.1)
    found = ours.registration_icp(source, np.vstack([target, target]), 0.1)
    assert found.fitness == expected.fitness == 1.0
    np.testing.assert_allclose(found.transformation, expected.transformation, atol=1e-9)


def test_nothing_found_is_no_pose():
    found = ours.registration_icp(np.full((5, 3), 9.0), np.random.default_rng(0).uniform(size=(50, 3)), 0.1)
    assert np.isnan(found.transformation).all()
    assert found.fitness == 0.0
    assert np.isnan(found.inlier_rmse)
    assert found.correspondence_set.shape == (0, 2)
    assert not found.converged


def test_criteria_end_the_run():
    source, target, _ = pair(3)
    one = ours.registration_icp(source, target, 0.5, criteria=ours.ICPConvergenceCriteria(max_iteration=1))
    assert (one.num_iterations, one.converged) == (1, False)
    loose = ours.registration_icp(source, target, 0.5, criteria=ours.ICPConvergenceCriteria(2.0, 2.0))
    assert (loose.num_iterations, loose.converged) == (1, True)


def test_what_cannot_be_done_is_said():
    source, target, _ = pair(0, 50)
    with pytest.raises(InputError, match="proper motions only"):
        ours.registration_icp(source, target, 1.0, estimation_method=theirs.TransformationEstimationPointToPoint(True))
    with pytest.raises(InputError, match="unknown estimation method"):
        ours.registration_icp(source, target, 1.0, estimation_method=theirs.TransformationEstimationForColoredICP())
    for reach in (0.0, -1.0, np.nan, "far", np.inf):
        with pytest.raises(InputError, match="max_correspondence_distance"):
            ours.registration_icp(source, target, reach)
    with pytest.raises(InputError, match="is a mesh"):
        ours.registration_icp(Mesh(*bracket()), target, 1.0)
    with pytest.raises(InputError, match="criteria"):
        ours.registration_icp(source, target, 1.0, criteria=30)
    with pytest.raises(InputError, match="max_iteration"):
        ours.ICPConvergenceCriteria(max_iteration=0)
    with pytest.raises(InputError, match="init"):
        ours.registration_icp(source, target, 1.0, np.diag([2.0, 2, 2, 1]))


def test_clouds_stay_as_they_were():
    source, target, _ = pair(0, 50)
    a, b = source.copy(), target.copy()
    ours.registration_icp(PointCloud(source), PointCloud(target), 1.0)
    np.testing.assert_array_equal(source, a)
    np.testing.assert_array_equal(target, b)
