import numpy as np
import pytest

from dqreg.geometry import PointCloud
from dqreg.multiway.peers import compare_many
from dqreg.multiway.scores import many_table, score, squared_errors, worst_vertices
from dqreg.rigid import pose
from dqreg.synth.many_views import room_stops, turntable_views
from dqreg.synth.parts import bracket


def test_errors_are_measured_after_the_best_common_motion() -> None:
    rng = np.random.default_rng(0)
    clouds = [PointCloud(rng.normal(size=(200, 3))) for _ in range(4)]
    truth = pose.random(rng, reach=2.0, shape=(4,))
    moved = pose.random(rng, reach=5.0) @ truth
    exact = score("exact", moved, truth, clouds, size=4.0)
    assert (exact.placed, exact.right) == (4, 4)
    assert exact.worst < 1e-12
    # One scan of three off by 0.4: the common motion takes a third of it back, and more by a rotation.
    moved[2] = moved[2] @ pose.from_parts(np.eye(3), [0.4, 0.0, 0.0])
    moved[3] = np.nan
    off = score("off", moved, truth, clouds, size=4.0)
    assert (off.placed, off.right) == (3, 0)
    # Oracle: Kabsch's best motion of all points, and what it leaves of the worst scan.
    there, exact = (np.concatenate([pose.apply(T[k], clouds[k].points) for k in range(3)]) for T in (moved, truth))
    a, b = there - there.mean(axis=0), exact - exact.mean(axis=0)
    U, _, Vt = np.linalg.svd(b.T @ a)
    left = (a @ (U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt).T - b).reshape(3, 200, 3)
    assert off.worst == pytest.approx(np.sqrt((left**2).sum(axis=2).mean(axis=1)).max(), rel=1e-9)


def test_the_steps_of_a_turntable_are_one_motion_and_its_views_fit_together() -> None:
    rng = np.random.default_rng(1)
    part = bracket()
    made = turntable_views(part, 6, pixels=40, noise=0.0, rng=rng)
    T = made.T_world_scan
    steps = pose.inverse(T[:-1]) @ T[1:]
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-9 * np.ptp(part[0]))
    assert float(pose.angle_between(steps[0], np.eye(4))) == pytest.approx(2 * np.pi / 6)
    low, high = part[0].min(axis=0), part[0].max(axis=0)
    for points, pose_of in zip(made.scans, T, strict=True):
        placed = pose.apply(pose_of, points)
        assert (placed > low - 1e-6).all()
        assert (placed < high + 1e-6).all()


def test_the_stops_in_a_room_see_its_walls() -> None:
    made = room_stops(3, rings=12, noise=0.0, rng=np.random.default_rng(2))
    for points, T in zip(made.scans, made.T_world_scan, strict=True):
        placed = np.abs(pose.apply(T, points))
        np.testing.assert_allclose(placed.max(axis=0), [4.0, 3.0, 1.5], atol=1e-6)


def test_all_engines_are_scored_on_the_same_scans() -> None:
    made = turntable_views(bracket(), 12, pixels=60, rng=np.random.default_rng(3))
    clouds, truth = [PointCloud(points) for points in made.scans[:2]], made.T_world_scan[:2]
    scores = compare_many(clouds, truth, starts=truth, effort="fast", workers=1)
    assert [each.engine for each in scores] == [
        "dqreg multiway",
        "Open3D, its example",
        "Open3D, our pairs",
        "chain of ICP, our pairs",
    ]
    assert scores[0].right == 2
    assert scores[0].remark == "accepted"
    assert len(many_table(scores, 2).rows) == 4


def test_worst_vertex_is_after_the_best_common_motion() -> None:
    rng, vertices = np.random.default_rng(3), np.random.default_rng(4).normal(size=(40, 3))
    truth = np.stack([pose.random(rng, reach=3.0) for _ in range(4)])
    common = pose.random(rng, reach=5.0)
    T = common @ truth
    np.testing.assert_allclose(worst_vertices(T, truth, vertices), 0.0, atol=1e-12)
    T[3] = np.nan
    off = np.array([1e-3, -1e-3, 0.0])
    # Two scans shifted to either side of the third: the best common motion leaves them there.
    for k, shift in enumerate(off):
        T[k] = common @ pose.from_parts(np.eye(3), [shift, 0.0, 0.0]) @ truth[k]
    np.testing.assert_allclose(worst_vertices(T, truth, vertices), [1e-3, 1e-3, 0.0, np.nan], atol=1e-9)


def test_squared_errors_are_those_of_draws_from_the_covariance() -> None:
    rng, count, unit = np.random.default_rng(1), 80, 7.0
    truth = np.stack([pose.random(rng, reach=3.0) for _ in range(count)])
    spread = rng.normal(size=(6 * count, 6 * count)) * 1e-5
    increments = (spread @ rng.normal(size=6 * count)).reshape(count, 6)
    centre, home = np.array([1.0, 2.0, 3.0]), pose.random(rng, reach=2.0)
    T = np.stack([pose.about(pose.exp(-each), centre) @ home @ t for each, t in zip(increments, truth, strict=True)])
    pairs = [(k, k + 1) for k in range(count - 1)]
    found = squared_errors(T, spread @ spread.T, centre, truth, pairs, unit)
    assert found.mean() == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / len(pairs)))
    T[5] = np.nan
    assert np.flatnonzero(np.isnan(squared_errors(T, spread @ spread.T, centre, truth, pairs, unit))).tolist() == [4, 5]
