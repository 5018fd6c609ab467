"""Means and blends: of rotations (Markley), of poses (Karcher, with covariances), of dual quaternions (DLB, DIB)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid import DualQuaternion, blend, pose
from dqreg.rigid import quaternion as quat

RNG = np.random.default_rng(12)


def near(centre, spread, count, rng=RNG):
    """Poses about a centre, by left increments with a spread."""
    return pose.exp(spread * rng.standard_normal((count, 6))) @ centre


def test_the_mean_rotation_agrees_with_scipy_whatever_the_signs():
    q = quat.from_matrix(near(pose.random(RNG), 0.4, 9)[:, :3, :3])
    signs, w = np.sign(RNG.standard_normal((9, 1))), RNG.uniform(0.1, 3, 9)
    for weights in (None, w):
        expected = Rotation.from_matrix(quat.to_matrix(q)).mean(weights).as_matrix()
        np.testing.assert_allclose(quat.to_matrix(quat.mean(signs * q, weights)), expected, atol=1e-14)
    for scale in (1e-200, 1e200):
        np.testing.assert_allclose(quat.mean(q, scale * w), quat.mean(q, w), atol=1e-14)


def test_the_mean_rotation_minimises_the_distance_of_matrices():
    R = near(np.eye(4), 0.7, 6)[:, :3, :3]
    w = RNG.uniform(0.1, 2, 6)

    def cost(x):
        return np.sum(w * np.sum((pose.exp([*x, 0, 0, 0])[:3, :3] - R) ** 2, axis=(1, 2)))

    best = minimize(cost, np.zeros(3), method="BFGS", options={"gtol": 1e-9})
    mine = pose.log(pose.from_parts(quat.to_matrix(quat.mean(quat.from_matrix(R), w)), np.zeros(3)))[:3]
    np.testing.assert_allclose(mine, best.x, atol=1e-6)


def test_means_of_stacks():
    q = quat.normalize(RNG.standard_normal(4) + 0.3 * RNG.standard_normal((2, 5, 7, 4)))
    whole = quat.mean(q)
    assert whole.shape == (2, 5, 4)
    np.testing.assert_allclose(whole[1, 3], quat.mean(q[1, 3]), atol=1e-15)


def test_rotations_without_a_mean_are_named():
    with pytest.raises(DegenerateGeometryError, match="half a turn apart"):
        quat.mean([[1, 0, 0, 0], [0, 1, 0, 0]])
    with pytest.raises(DegenerateGeometryError, match="half a turn apart"):
        quat.mean(np.eye(4))
    np.testing.assert_allclose(quat.mean([[1, 0, 0, 0], [0, 1, 0, 0]], [1, 2]), [0, 1, 0, 0], atol=1e-15)
    for weights, words in (([1, 2], "weights must hold"), ([0, 0, 0], "all zero"), ([1, -1, 1], "negative")):
        with pytest.raises(InputError, match=words):
            quat.mean(np.tile([1.0, 0, 0, 0], (3, 1)), weights)
    with pytest.raises(InputError, match="at least one"):
        quat.mean([1, 0, 0, 0])


def test_the_mean_pose_is_where_the_twists_add_up_to_zero_in_either_frame():
    poses, w = near(pose.random(RNG, reach=5), 0.3, 8), RNG.uniform(0.1, 2, 8)
    found = pose.mean(poses, w).T_target_source
    np.testing.assert_allclose(w @ pose.log(poses @ pose.inverse(found)), 0, atol=1e-12)
    np.testing.assert_allclose(w @ pose.log(pose.inverse(found) @ poses), 0, atol=1e-12)
    A, B = pose.random(RNG, reach=20, shape=(2,))
    np.testing.assert_allclose(pose.mean(A @ poses @ B, w).T_target_source, A @ found @ B, atol=1e-11)


def test_the_mean_of_two_is_halfway_along_the_screw_and_of_one_itself():
    A, B = pose.random(RNG, reach=5, shape=(2,))
    middle = DualQuaternion.from_matrix(A).sclerp(DualQuaternion.from_matrix(B), 0.5).as_matrix()
    np.testing.assert_allclose(pose.mean([A, B]).T_target_source, middle, atol=1e-13)
    alone = pose.mean([A])
    np.testing.assert_allclose(alone.T_target_source, A, atol=1e-14)
    assert np.isnan(alone.covariance).all()
    assert np.isnan(alone.scatter).all()


def test_far_from_the_origin_the_mean_keeps_its_digits():
    far = pose.from_parts(np.eye(3), [1e6, 0, 0])
    poses = near(np.eye(4), 0.1, 20)
    here, there = pose.mean(poses), pose.mean(far @ poses)
    np.testing.assert_allclose(there.T_target_source, far @ here.T_target_source, rtol=0, atol=1e-9)


def nees(found, C, truth):
    x = pose.log(truth @ pose.inverse(found))
    return x @ np.linalg.solve(C, x)


def test_the_covariance_of_the_mean_keeps_its_word():
    # With a covariance estimated from n = 20 the squared error follows Hotelling's T squared, whose mean is
    # (n - 1) p / (n - p - 2) = 9.5 for p = 6. Five standard errors of 200 trials are allowed: a covariance off by a
    # factor of two is far outside.
    rng, truth = np.random.default_rng(1), pose.random(np.random.default_rng(2), reach=3)
    values = []
    for _ in range(200):
        found = pose.mean(near(truth, 0.01, 20, rng))
        values.append(nees(found.T_target_source, found.covariance, truth))
    expected = 19 * 6 / (20 - 6 - 2)
    assert np.mean(values) == pytest.approx(expected, abs=5 * np.std(values) / np.sqrt(200))


def test_fused_poses_have_the_covariance_that_they_say():
    # Chi squared with six degrees of freedom: 6 on average, and its standard error is sqrt(12 / 150) = 0.28.
    rng, truth = np.random.default_rng(3), pose.random(np.random.default_rng(4), reach=3)
    values = []
    for _ in range(150):
        roots = 0.02 * rng.standard_normal((5, 6, 6))
        C = roots @ np.swapaxes(roots, 1, 2) + 1e-5 * np.eye(6)
        draws = np.einsum("nij,nj->ni", np.linalg.cholesky(C), rng.standard_normal((5, 6)))
        found = pose.mean(pose.exp(draws) @ truth, covariances=C)
        values.append(nees(found.T_target_source, found.covariance, truth))
    assert np.mean(values) == pytest.approx(6, abs=1.2)


def test_fusion_agrees_with_pytransform3d_and_with_equal_weights():
    poses = near(pose.random(RNG, reach=2), 0.05, 4)
    roots = 0.1 * RNG.standard_normal((4, 6, 6))
    C = roots @ np.swapaxes(roots, 1, 2) + 1e-3 * np.eye(6)
    found = pose.mean(poses, covariances=C)
    same = pose.mean(poses, covariances=np.tile(np.eye(6), (4, 1, 1)))
    # Left increments of equal covariance: the Karcher mean, up to the curvature of 0.05 rad squared.
    np.testing.assert_allclose(same.T_target_source, pose.mean(poses).T_target_source, atol=0.02)
    np.testing.assert_allclose(same.covariance, np.eye(6) / 4, atol=0.02)
    uncertainty = pytest.importorskip("pytransform3d.uncertainty")
    theirs, covariance, _ = uncertainty.pose_fusion(poses, C)
    np.testing.assert_allclose(found.T_target_source, theirs, atol=1e-6)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-3, atol=1e-7)


def fused_at(place, near_zero, C):
    return pose.mean(pose.from_parts(np.eye(3), place) @ near_zero, covariances=C, centre=place)


def test_far_away_poses_are_fused_about_a_centre_as_at_home():
    # At 5e6, as UTM coordinates are, doubles hold 1e-9 of the translations.
    rng = np.random.default_rng(5)
    for _ in range(30):
        roots = np.diag(10.0 ** rng.uniform(-3, -1, 6)) @ (np.eye(6) + 0.3 * rng.standard_normal((4, 6, 6)))
        C = roots @ np.swapaxes(roots, 1, 2)
        poses = pose.exp(np.einsum("nij,nj->ni", roots, rng.standard_normal((4, 6)))) @ pose.random(rng, reach=3)
        place = 5e6 * np.array([1, 0.3, -0.2])
        home, there = pose.mean(poses, covariances=C), fused_at(place, poses, C)
        back = there.T_target_source - home.T_target_source
        np.testing.assert_allclose(back[:3, 3], place, rtol=0, atol=2e-7)
        np.testing.assert_allclose(back[:3, :3], 0, atol=1e-7)
        for name in ("covariance", "scatter"):
            here = getattr(home, name)
            size = np.sqrt(here.diagonal())
            np.testing.assert_allclose((getattr(there, name) - here) / size / size[:, None], 0, atol=1e-5)


def test_the_centre_is_a_change_of_words_only():
    rng = np.random.default_rng(6)
    poses, c = near(pose.random(rng, reach=2), 0.1, 5, rng), np.array([3.0, -1, 2])
    A, plain = pose.adjoint(pose.from_parts(np.eye(3), -c)), pose.mean(poses)
    about = pose.mean(poses, centre=c)
    np.testing.assert_array_equal(about.T_target_source, plain.T_target_source)
    np.testing.assert_allclose(about.scatter, A @ plain.scatter @ A.T, atol=1e-14)
    roots = 0.1 * rng.standard_normal((5, 6, 6))
    C = roots @ np.swapaxes(roots, 1, 2) + 1e-3 * np.eye(6)
    fused, same = pose.mean(poses, covariances=C), pose.mean(poses, covariances=A @ C @ A.T, centre=c)
    np.testing.assert_allclose(same.T_target_source, fused.T_target_source, atol=1e-10)
    np.testing.assert_allclose(same.covariance, A @ fused.covariance @ A.T, rtol=1e-8, atol=1e-12)
    with pytest.raises(InputError, match="centre must be three"):
        pose.mean(poses, centre=[1, 2])


DRAWS = 12


@pytest.mark.parametrize("far", [1e5, 1e6, 5e6, 1e9])
def test_covariances_that_rounding_has_spoilt_are_refused_with_the_remedy(far):
    rng, refused = np.random.default_rng(7), []
    c = far * np.array([1, 0.3, -0.2])
    A = pose.adjoint(pose.from_parts(np.eye(3), c))
    for _ in range(DRAWS):
        roots = np.einsum("ni,ij->nij", 10.0 ** rng.uniform(-3, -1, (4, 6)), np.eye(6))
        draws = np.einsum("nij,nj->ni", roots, rng.standard_normal((4, 6)))
        C = A @ roots @ np.swapaxes(roots, 1, 2) @ A.T
        try:
            found = pose.mean(pose.from_parts(np.eye(3), c) @ pose.exp(draws), covariances=C)
        except InputError as error:
            refused.append(str(error))
        else:
            home = pose.adjoint(pose.from_parts(np.eye(3), -c))
            assert np.linalg.eigvalsh(home @ found.covariance @ home.T)[0] > 0.0
    assert all("centre=" in message for message in refused)
    # Between, rounding spoils some.
    least, most = {1e5: (0, 0), 1e9: (DRAWS, DRAWS)}.get(far, (1, DRAWS))
    assert least <= len(refused) <= most


def test_errors_of_the_mean_pose():
    two = pose.exp([[0, 0, 0, 1, 2, 3], [0.1, 0, 0, 1, 2, 3]])
    C = np.tile(np.eye(6), (2, 1, 1))
    for arguments, words in (
        (([],), "T must"),
        ((np.zeros((2, 4, 4)),), "T must"),
        ((two, [1, 2, 3]), "weights must"),
    ):
        with pytest.raises(InputError, match=words):
            pose.mean(*arguments)
    with pytest.raises(InputError, match="not both"):
        pose.mean(two, [1, 1], covariances=C)
    with pytest.raises(InputError, match="above 0"):
        pose.mean(two, covariances=-C)
    with pytest.raises(InputError, match=r"\(2, 6, 6\)"):
        pose.mean(two, covariances=C[:1])
    with pytest.raises(DegenerateGeometryError, match="half a turn"):
        pose.mean(pose.exp([[0, 0, 0, 1, 2, 3], [np.pi, 0, 0, 1, 2, 3]]))


@pytest.mark.parametrize("method", ["linear", "screw"])
def test_blends_move_with_the_motions_and_know_no_sign(method):
    q = DualQuaternion.from_matrix(near(pose.random(RNG, reach=3), 0.4, 5))
    w = RNG.uniform(0, 1, (7, 5))
    found = blend(q, w, method=method)
    assert found.shape == (7,)
    signed = DualQuaternion.from_array(np.sign(RNG.standard_normal((5, 1))) * q.as_array())
    assert np.all(blend(signed, w, method=method).isclose(found))
    a, b = (DualQuaternion.from_matrix(T) for T in pose.random(RNG, reach=3, shape=(2,)))
    assert np.all(blend(a * q * b, w, method=method).isclose(a * found * b))
    assert np.all(blend(q, [0, 0, 1, 0, 0], method=method).isclose(q[2]))
    assert blend(q[:1], method=method).isclose(q[0])


def test_two_motions_blend_along_their_screw():
    ends = DualQuaternion.from_matrix(pose.random(RNG, reach=3, shape=(2,)))
    t = np.linspace(0, 1, 11)
    w, path = np.column_stack([1 - t, t]), ends[0].sclerp(ends[1], t)
    assert np.all(blend(ends, w, method="screw").isclose(path, angle_rad=1e-11, distance=1e-10))
    linear = blend(ends, w)
    assert linear[5].isclose(path[5], angle_rad=1e-11, distance=1e-10)
    # Kavan et al. 2008: the same axis, and at most 0.143 rad (8.15 degrees) off in the angle.
    apart = (path.inverse() * linear).as_screw()
    assert np.max(apart.angle_rad) < 0.143
    assert np.max(apart.angle_rad) > 1e-3


def test_the_blend_by_screws_is_the_mean_pose():
    poses, w = near(pose.random(RNG, reach=3), 0.4, 6), RNG.uniform(0, 1, 6)
    found = blend(DualQuaternion.from_matrix(poses), w, method="screw").as_matrix()
    np.testing.assert_allclose(found, pose.mean(poses, w).T_target_source, atol=1e-11)


def test_errors_of_blends():
    q = DualQuaternion.from_screw([0, 0, 1], [0.0, np.pi])
    with pytest.raises(InputError, match="method"):
        blend(q, method="cubic")
    with pytest.raises(InputError, match="at least one"):
        blend(q[0])
    with pytest.raises(InputError, match="weights must hold"):
        blend(q, [1, 2, 3])
