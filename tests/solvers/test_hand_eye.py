from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid import pose
from dqreg.solvers import hand_eye, robot_world_hand_eye
from dqreg.solvers.hand_eye_start import starts
from tests.solvers.hand_eye_cases import METHODS, SIGMAS, by_opencv, drawn_pose, increment, noisy, stations


def motions(rng, count, X):
    """Motions A of the hand, from stations of 40 degrees and 0.4 m, and those of the eye, without noise."""
    A = stations(rng, count)
    return A, pose.inverse(X) @ A @ X


def measured(rng, count):
    """Stations of a hand, what the eye sees there without noise, and T_hand_eye."""
    X, base, world = drawn_pose(rng, 0.2), drawn_pose(rng, 0.5), drawn_pose(rng, 1.0)
    hands = base @ stations(rng, count)
    return hands, pose.inverse(X) @ pose.inverse(hands) @ world, X, world


def first_dual(A, B):
    return starts(A, B)[0]


def first_plain(A, B):
    return starts(A, B)[1]


@pytest.mark.parametrize("count", [2, 3, 10, 100])
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_exact_motions_give_the_exact_transform(count, unit):
    rng = np.random.default_rng([1, count])
    X = drawn_pose(rng, 0.2)
    X[:3, 3] *= unit
    A = stations(rng, count)
    A[:, :3, 3] *= unit
    B = pose.inverse(X) @ A @ X
    # The closed forms are good to half of the digits.
    for tolerance, found in ((1e-12, hand_eye(A, B).X), (1e-6, first_dual(A, B)), (1e-6, first_plain(A, B))):
        np.testing.assert_allclose(found[:3, :3], X[:3, :3], rtol=0, atol=tolerance)
        np.testing.assert_allclose(found[:3, 3], X[:3, 3], rtol=0, atol=tolerance * unit)


@pytest.mark.parametrize("count", [3, 10, 60])
def test_exact_stations_give_both_exact_transforms(count):
    rng = np.random.default_rng([2, count])
    hands, targets, X, world = measured(rng, count)
    fit = robot_world_hand_eye(pose.inverse(hands), targets)
    np.testing.assert_allclose(fit.X, world, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fit.Y, X, rtol=0, atol=1e-12)
    # The same sensor beside the robot, and the target on the hand.
    fixed = robot_world_hand_eye(hands, pose.inverse(X) @ hands @ world)
    np.testing.assert_allclose(fixed.Y, X, rtol=0, atol=1e-12)


def test_half_turns_and_no_translation_are_motions_like_others():
    A = np.array([np.diag([1.0, -1, -1, 1]), np.diag([-1.0, 1, -1, 1]), pose.exp([0.3, 0.4, 0.5, 1, 0, 0])])
    X = drawn_pose(np.random.default_rng(3), 1.0)
    np.testing.assert_allclose(hand_eye(A, pose.inverse(X) @ A @ X).X, X, rtol=0, atol=1e-12)


# The mean of a chi-square with six degrees of freedom over n trials has a standard error of sqrt(12 / n).
TRIALS = [(40, 1.6), pytest.param(1200, 0.3, marks=pytest.mark.soak)]


@pytest.mark.parametrize(("trials", "allowed"), TRIALS)
@pytest.mark.parametrize("robot_too", [False, True])
@pytest.mark.parametrize("solver", ["motions", "stations"])
def test_errors_are_as_large_as_the_covariance_says(solver, robot_too, trials, allowed):
    total = 0.0
    sigma_A = (4e-4, 1e-3) if robot_too else None
    for k in range(trials):
        rng = np.random.default_rng([4, k])
        if solver == "motions":
            X = drawn_pose(rng, 0.2)
            A, B = motions(rng, 10, X)
            rows = (noisy(rng, A, sigma_A) if sigma_A else A, noisy(rng, B, SIGMAS))
            fit = hand_eye(*rows, sigma_A=sigma_A, sigma_B=SIGMAS)
            e, C = increment(X, fit.X), fit.covariance
        else:
            hands, targets, X, _ = measured(rng, 10)
            A = pose.inverse(hands)
            rows = (noisy(rng, A, sigma_A) if sigma_A else A, noisy(rng, targets, SIGMAS))
            fit = robot_world_hand_eye(*rows, sigma_A=sigma_A, sigma_B=SIGMAS)
            e, C = increment(X, fit.Y), fit.covariance[6:, 6:]
        total += e @ np.linalg.solve(C, e)
    assert total / trials == pytest.approx(6.0, abs=allowed)


def test_noise_that_is_not_given_is_found_in_the_residuals():
    rng = np.random.default_rng(5)
    X = drawn_pose(rng, 0.2)
    A, B = motions(rng, 200, X)
    fit = hand_eye(A, noisy(rng, B, SIGMAS))
    # 597 residuals know a standard deviation to 3 %.
    assert (fit.sigma_rotation, fit.sigma_translation) == pytest.approx(SIGMAS, rel=0.1)
    assert np.sqrt(np.mean(fit.rotation_residuals**2) / 3) == pytest.approx(SIGMAS[0], rel=0.1)
    told = hand_eye(A, noisy(np.random.default_rng(6), B, SIGMAS), sigma_B=SIGMAS)
    np.testing.assert_allclose(fit.covariance.diagonal(), told.covariance.diagonal(), rtol=0.2)


def compare(count, trials, seed):
    """Root mean square errors of rotation and translation of OpenCV's five and of ours, and the mean NEES of ours."""
    cv2 = pytest.importorskip("cv2", reason="pip install 'dqreg[peers]'")
    if not hasattr(cv2, "calibrateHandEye"):
        pytest.skip("this OpenCV has no calibrateHandEye")
    names = (*METHODS, "ours")
    squares, nees = np.zeros((2, len(names), 2)), np.zeros(2)
    for k in range(trials):
        rng = np.random.default_rng([seed, count, k])
        X = drawn_pose(rng, 0.2)
        A, B = motions(rng, count, X)
        B = noisy(rng, B, SIGMAS)
        # n motions with noise of their own: stations about a first one that is exact.
        first = np.eye(4)[None]
        rows = [(np.concatenate([first, A]), np.concatenate([first, pose.inverse(B)]))]
        fit = hand_eye(A, B)
        ours = [(increment(X, fit.X), fit.covariance)]
        truths = [X]
        hands, targets, X, _ = measured(rng, count + 1)
        targets = noisy(rng, targets, SIGMAS)
        rows.append((hands, targets))
        both = robot_world_hand_eye(pose.inverse(hands), targets)
        ours.append((increment(X, both.Y), both.covariance[6:, 6:]))
        truths.append(X)
        for way in (0, 1):
            errors = [increment(truths[way], by_opencv(cv2, *rows[way], method)) for method in METHODS]
            errors.append(ours[way][0])
            squares[way] += [(e[:3] @ e[:3], e[3:] @ e[3:]) for e in errors]
            nees[way] += ours[way][0] @ np.linalg.solve(ours[way][1], ours[way][0])
    return np.sqrt(squares / trials), nees / trials


def assert_never_worse(count, trials, seed):
    errors, nees = compare(count, trials, seed)
    for way in (0, 1):
        best = errors[way, :-1].min(axis=0)
        assert (errors[way, -1] <= best).all(), (count, way, errors[way])
    return nees


def test_no_method_of_opencv_is_nearer_on_ten_motions():
    assert_never_worse(10, 15, 7)


@pytest.mark.soak
@pytest.mark.parametrize(("count", "trials"), [(10, 600), (30, 400), (100, 200)])
def test_no_method_of_opencv_is_nearer_and_the_covariance_holds(count, trials):
    nees = assert_never_worse(count, trials, 8)
    # The noise is estimated too, which adds a few per cent at ten motions.
    np.testing.assert_allclose(nees, 6.0, rtol=0, atol=0.5)


def parallel(rng, count, noise=0.0):
    turns = np.column_stack([np.zeros((count, 2)), rng.uniform(-1, 1, count), rng.uniform(-1, 1, (count, 3))])
    A = np.array([pose.exp(turn) for turn in turns])
    X = drawn_pose(rng, 0.2)
    return A, noisy(rng, pose.inverse(X) @ A @ X, (noise, noise))


RNG = np.random.default_rng(9)
EYE = np.eye(4)[None].repeat(4, axis=0)
DEGENERATE = {
    "one motion": (stations(RNG, 1), stations(RNG, 1), "one motion leaves a rotation about its axis"),
    "no motion": (EYE[:0], EYE[:0], "got 0 motions"),
    "no rotation": (EYE, EYE, "no motion rotates"),
    "parallel axes": (*parallel(RNG, 8), "axes of all rotations are parallel"),
    "parallel within the noise": (
        noisy(RNG, (rows := parallel(RNG, 8, 1e-3))[0], (1e-3, 1e-3)),
        rows[1],
        "axes of all rotations are parallel",
    ),
}


@pytest.mark.parametrize("case", DEGENERATE)
def test_what_leaves_the_transform_open_is_named(case):
    A, B, words = DEGENERATE[case]
    with pytest.raises(DegenerateGeometryError, match=words):
        hand_eye(A, B)


def test_two_stations_are_one_motion():
    hands, targets, *_ = measured(np.random.default_rng(10), 2)
    with pytest.raises(DegenerateGeometryError, match="three stations or more; got 1 motion:"):
        robot_world_hand_eye(hands, targets)
    with pytest.raises(DegenerateGeometryError, match="got 0 motions"):
        robot_world_hand_eye(hands[:1], targets[:1])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda A: hand_eye(A, A[:2]), "same|must both have shape"),
        (lambda A: hand_eye(A[0], A[0]), r"shape \(n, 4, 4\)"),
        (lambda A: hand_eye(2.0 * A, A), "A "),
        (lambda A: hand_eye(A, A * np.nan), "B holds"),
        (lambda A: hand_eye(A, A, sigma_B=1e-3), "two numbers"),
        (lambda A: hand_eye(A, A, sigma_B=(-1, 1)), "0 or more"),
        (lambda A: hand_eye(A, A, sigma_A=(0, 1)), "above 0"),
        (lambda A: hand_eye("A", A), "A must be an array"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(InputError, match=words):
        call(stations(np.random.default_rng(11), 4))
