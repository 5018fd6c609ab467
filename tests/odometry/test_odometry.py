from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement

pytest.importorskip("kiss_icp")

from dqreg.compare.trust.kinds import KINDS
from dqreg.errors import InputError, MissingDependencyError
from dqreg.odometry import Odometry, evaluate, kiss, nees
from dqreg.odometry.evaluation import relative_errors
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose

PROJECT = Path(__file__).parents[2] / "pyproject.toml"


def run(frames, times=None, **options) -> tuple[Odometry, list[Registration]]:
    odometry = Odometry(**options)
    return odometry, [odometry.register_frame(f, None if times is None else times[i]) for i, f in enumerate(frames)]


@pytest.fixture(scope="module")
def followed(jerky):
    return run(jerky.frames)


def test_turns_that_constant_velocity_misses_by_70_degrees_are_followed(jerky, followed):
    odometry, results = followed
    # Truth: the poses that the rays were cast from. Range noise 0.01 over thousands of points; the bounds are three
    # times what the covariances promise (0.05 degrees, 0.005).
    turn, shift = relative_errors(odometry.poses, jerky.truth, 1)
    assert [r.verdict.level for r in results] == ["accepted"] * len(results)
    assert turn.max() < 0.15
    assert shift.max() < 0.015


def test_covariances_keep_their_word(jerky, followed):
    odometry, results = followed
    # Six on average where they are exact; 2.9 on this ride, 4.8 over four like it. Half of that would be sigmas that
    # nobody can use, twice of it too much trust.
    values = nees(odometry.poses, [r.covariance for r in results], jerky.truth)
    assert 2.0 < values.mean() < 12.0


@pytest.mark.parametrize("first", [20_410, 20_416])
def test_covariances_of_steps_are_those_of_their_errors(first):
    # Through halls with furniture, whose cells along the edges of floor and walls lift planes: the errors came to 0.54
    # of the covariances while these held a pose, which erred by 3.5 then.
    values, shifts = [], []
    for seed in range(first, first + 6):
        drive = KINDS["drive-hall"].task(seed)
        odometry, results = run(drive.frames)
        values.append(nees(odometry.poses, [r.covariance for r in results], drive.poses))
        shifts.append(relative_errors(odometry.poses, drive.poses, 1)[1])
    assert 0.7 < np.mean(values) / 6.0 < 1.6
    assert np.sqrt(np.mean(np.square(shifts))) < 1.5e-3


def test_the_map_frame_is_the_first_frame_or_the_start(jerky, followed):
    np.testing.assert_array_equal(followed[0].poses[0], np.eye(4))
    start = jerky.truth[0]
    odometry, results = run(jerky.frames[:2], start=start)
    np.testing.assert_allclose(odometry.poses[0], start, atol=1e-12)
    # Not to the last digit: the voxels of the map lie differently in another frame.
    expected = start @ followed[0].poses[1]
    assert pose.offset_between(odometry.poses[1], expected) < 0.02
    np.testing.assert_allclose(results[1].settings["centre"], odometry.poses[1][:3, 3])


def test_a_run_repeats_to_the_last_bit(jerky):
    first, second = (run(jerky.frames[:3])[0].poses for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_frames_stay_as_they_were(jerky):
    before = jerky.frames[0].copy()
    run(jerky.frames[:1])
    np.testing.assert_array_equal(jerky.frames[0], before)


def test_motion_during_the_sweep_is_undone_with_the_times_of_the_points(smooth):
    with_times, without = (run(smooth.frames, times)[0].poses for times in (smooth.times, None))
    # Without the times each frame is bent by its own motion: 5 degrees and 0.3 over the sweep.
    errors = [relative_errors(poses, smooth.truth, 1)[1] for poses in (with_times, without)]
    assert errors[0].max() < 0.02
    assert errors[0].max() < 0.5 * errors[1].max()


def test_the_motion_during_the_first_sweep_is_undone_once_the_second_tells_it(moving):
    # Truth as above. A map that began skewed bends what follows: errors of 2 degrees and 0.1 where it was left so.
    odometry, results = run(moving.frames, moving.times)
    turn, shift = relative_errors(odometry.poses, moving.truth, 1)
    assert [r.verdict.level for r in results] == ["accepted"] * len(results)
    assert turn.max() < 0.2
    assert shift.max() < 0.02


def test_a_frame_of_another_place_is_reported_and_not_absorbed(jerky):
    rng = np.random.default_rng(3)
    foreign = rng.normal(size=(1500, 3)) * [3.0, 2.0, 1.0]
    frames = [*jerky.frames[:4], foreign, *jerky.frames[4:6]]
    odometry, results = run(frames, map_search="never")
    assert [r.verdict.level for r in results] == ["accepted"] * 4 + ["failed"] + ["accepted"] * 2
    assert [r.verdict.codes for r in results] == [
        ("first_frame",),
        *[("accepted",)] * 3,
        ("lost",),
        *[("accepted",)] * 2,
    ]
    assert np.isnan(odometry.poses[4]).all()
    placed = np.delete(odometry.poses, 4, axis=0)
    turn, shift = relative_errors(placed, jerky.truth[:6], 1)
    assert turn.max() < 0.2
    assert shift.max() < 0.02


BAD = {
    "empty": lambda f: np.zeros((0, 3)),
    "list": lambda f: [],
    "nan": lambda f: np.full_like(f, np.nan),
    "one voxel": lambda f: np.tile(f[:1], (500, 1)),
    "one ring": lambda f: f[::24][:40],
    "other unit": lambda f: 1000.0 * f,
    "huge": lambda f: np.full_like(f, 1e300),
    "origin": lambda f: np.zeros_like(f),
}


def test_bad_frames_fail_alone_and_the_trajectory_goes_on(jerky):
    odometry = Odometry()
    levels = [odometry.register_frame(jerky.frames[0]).verdict.level]
    for name, spoil in BAD.items():
        result = odometry.register_frame(spoil(jerky.frames[1]))
        assert result.verdict.level in ("failed", "suspect"), name
        assert result.verdict.level == "suspect" or np.isnan(result.T_target_source).all(), name
        assert np.isnan(odometry.poses[-1]).all() or result.verdict.level == "suspect", name
    levels.append(odometry.register_frame(jerky.frames[1]).verdict.level)
    assert levels == ["accepted", "accepted"]
    assert len(odometry.poses) == len(BAD) + 2
    assert pose.offset_between(odometry.poses[-1], pose.inverse(jerky.truth[0]) @ jerky.truth[1]) < 0.02


def test_a_bad_first_frame_does_not_begin_the_map(jerky):
    odometry, results = run([np.zeros((0, 3)), np.ones((9, 3)), *jerky.frames[:2]])
    assert [r.verdict.level for r in results] == ["failed", "failed", "accepted", "accepted"]
    np.testing.assert_array_equal(odometry.poses[2], np.eye(4))


def test_returns_that_are_nan_are_left_out_and_counted(jerky):
    spoiled = jerky.frames[1].copy()
    spoiled[::3] = np.nan
    _, results = run([jerky.frames[0], spoiled])
    assert results[1].verdict.level == "accepted"
    assert "2400 of 7200 returns are NaN" in results[1].verdict.reasons[-1]


# KISS-ICP's core ends the process where all times are one.
@pytest.mark.parametrize("stamps", [np.zeros(7200), np.full(7200, np.nan), np.full(7200, 5.0)])
def test_times_that_say_nothing_leave_the_frame_as_it_is(jerky, stamps):
    _, plain = run(jerky.frames[:2])
    _, results = run(jerky.frames[:2], [None, stamps])
    assert results[1].verdict.level == "accepted"
    assert "was not deskewed" in results[1].verdict.reasons[-1]
    np.testing.assert_array_equal(results[1].T_target_source, plain[1].T_target_source)


def test_times_out_of_order_in_a_frame_do_not_lose_it(jerky):
    shuffled = np.random.default_rng(0).permutation(7200) / 7200
    _, results = run(jerky.frames[:5], [None, None, None, shuffled, None])
    assert [r.verdict.level for r in results] == ["accepted"] * 5


def test_repeated_and_backward_stamps_are_named(jerky):
    odometry = Odometry()
    results = [odometry.register_frame(f, stamp=s) for f, s in zip(jerky.frames[:4], (0.0, 0.5, 0.5, 0.2), strict=True)]
    assert [r.verdict.level for r in results] == ["accepted", "accepted", "suspect", "suspect"]
    assert "is not after" in results[2].verdict.reasons[0]
    turn, _ = relative_errors(odometry.poses, jerky.truth[:4], 1)
    assert turn.max() < 0.15
    # Stamps that go back are no times of a trajectory: the frames' numbers stand in.
    np.testing.assert_array_equal(odometry.trajectory.times, np.arange(4))
    np.testing.assert_allclose(odometry.trajectory.poses, odometry.poses, atol=1e-12)


def test_a_corridor_without_ends_is_named_as_free():
    # Two walls and a floor say nothing about the way along them: the covariance must not claim to know.
    rng, side = np.random.default_rng(0), np.arange(9000) % 3

    def corridor():
        along, across, up = (rng.uniform(low, high, 9000) for low, high in ((-20, 20), (-1.5, 1.5), (-1, 2)))
        walls = np.column_stack([along, np.choose(side, [-1.5, 1.5, across]), np.where(side == 2, -1, up)])
        return walls + rng.normal(0, 0.01, (9000, 3))

    _, results = run([corridor(), corridor() + np.array([0.2, 0.01, 0.0])])
    assert results[1].verdict.level == "suspect"
    assert any(reason.startswith("unconstrained: translation along (1.00") for reason in results[1].verdict.reasons)
    assert np.isnan(results[1].covariance[3, 3])


def test_input_that_is_a_mistake_of_the_caller_raises(jerky):
    odometry = Odometry()
    with pytest.raises(InputError, match=r"shape \(n, 3\)"):
        odometry.register_frame(np.zeros((4, 2)))
    with pytest.raises(InputError, match="one a point"):
        odometry.register_frame(jerky.frames[0], np.zeros(3))
    with pytest.raises(InputError, match="voxel_size"):
        Odometry(voxel_size=-1.0)
    with pytest.raises(InputError, match="deskew must be True or False; got 'no'"):
        Odometry(deskew="no")
    with pytest.raises(InputError, match="insert must be True or False; got 0"):
        odometry.register_frame(jerky.frames[0], insert=0)
    with pytest.raises(InputError, match="unknown setting voxel"):
        Odometry(voxel=1.0)
    assert len(odometry.poses) == 0


def test_a_missing_package_is_named_with_the_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "kiss_icp.mapping", None)
    with pytest.raises(MissingDependencyError, match="pip install"):
        kiss.load_kiss("mapping")


@pytest.mark.parametrize(
    ("system", "machine", "version", "has_wheel"),
    [
        ("linux", "x86_64", (3, 13), True),
        ("linux", "aarch64", (3, 11), True),
        ("darwin", "arm64", (3, 12), True),
        ("darwin", "x86_64", (3, 12), False),
        ("linux", "x86_64", (3, 14), False),
    ],
)
def test_a_machine_without_a_wheel_of_kiss_icp_is_named(monkeypatch, system, machine, version, has_wheel):
    # From the wheels' names at PyPI, kiss-icp 1.3.0; the marker in pyproject.toml says the same.
    monkeypatch.setitem(sys.modules, "kiss_icp.mapping", None)
    monkeypatch.setattr(kiss.sys, "platform", system)
    monkeypatch.setattr(kiss.sys, "version_info", version)
    monkeypatch.setattr(kiss.platform, "machine", lambda: machine)
    with pytest.raises(MissingDependencyError) as caught:
        kiss.load_kiss("mapping")
    assert ("no wheel of KISS-ICP" in str(caught.value)) is not has_wheel
    wanted = next(
        Requirement(each)
        for each in tomllib.loads(PROJECT.read_text())["project"]["dependencies"]
        if each.startswith("kiss-icp")
    )
    marked = {"sys_platform": system, "platform_machine": machine, "python_version": "{}.{}".format(*version)}
    assert wanted.marker is not None
    assert wanted.marker.evaluate(marked) is has_wheel


def test_three_changed_lines_of_a_kiss_icp_user(jerky):
    odometry = Odometry(max_range=100.0)
    for frame in jerky.frames[:2]:
        odometry.register_frame(frame, np.array([]))
    assert odometry.last_pose.shape == (4, 4)
    assert len(odometry.local_map) > 1000


@pytest.mark.real
def test_balm_sequence_no_frame_lost_and_better_than_kiss_icp(real_data: Path):
    # Twelve frames around the step of 43 degrees. Truth: LiDAR-inertial poses good to about 1 cm / 0.1 degrees.
    # KISS-ICP with its defaults is the best of the configurations tried on the whole sequence.
    from dqreg.odometry.peers import KissEngine, run_engine
    from dqreg.odometry.run_sequence import run_sequence
    from dqreg.odometry.scans import open_scans
    from dqreg.odometry.settings import OdometrySettings
    from dqreg.odometry.trajectory import read_trajectory

    folder = real_data / "balm_lidar_seq_a"
    scans = open_scans(folder)
    part = type(scans)(scans.names[28:40], lambda i: scans.read(i + 28), None)
    truth = read_trajectory(folder / "poses.txt")[0][28:40]
    ours = run_sequence(part, OdometrySettings())
    errors = evaluate(ours.poses, truth)
    theirs = evaluate(run_engine("kiss", KissEngine(), part).poses, truth)
    assert errors.lost == 0
    assert all(result.verdict.level == "accepted" for result in ours.results)
    for step in (1, 10):
        for mine, kiss_error in zip(errors.steps[step], theirs.steps[step], strict=True):
            assert np.median(mine) <= np.median(kiss_error)
    assert np.median(errors.steps[1][0]) < 0.1
    assert np.median(errors.steps[1][1]) < 0.01


@pytest.mark.parametrize("stray", [[1e6, 0.0, 0.0], [1e30, 1e30, 1e30]])
def test_one_stray_in_each_frame_stretches_no_map(jerky, followed, stray):
    # The poses without it are the reference: the frames are registered alike but for what is rounded.
    odometry, results = run([np.concatenate([frame, [stray]]) for frame in jerky.frames[:4]])
    assert [r.verdict.level for r in results] == ["accepted"] * 4
    turn, shift = relative_errors(odometry.poses, followed[0].poses[:4], 1)
    assert turn.max() < 0.05
    assert shift.max() < 0.005
