from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dqreg
from dqreg.errors import DqregError, InputError
from dqreg.rigid import DualQuaternion, pose, quaternion
from dqreg.solvers import Freedom, PoseCost, horn, likelihood_weights, solve, solve_many, svd, walker1991

NAN, INF = float("nan"), float("inf")
P = np.random.default_rng(0).normal(size=(6, 3))
M = P / np.linalg.norm(P, axis=1, keepdims=True)
T = pose.random(np.random.default_rng(1), reach=5.0)
Q, N = pose.apply(T, P), M @ T[:3, :3].T


def spoilt(value: float, base: Any = P) -> Any:
    """One number replaced."""
    array = base.copy()
    array[2, 1] = value
    return array


# Arguments that no solver of matches may take for anything.
WRONG: dict[str, tuple[Any, ...]] = {
    "NaN source": (spoilt(NAN), Q),
    "NaN target": (P, spoilt(NAN)),
    "infinite source": (spoilt(INF), Q),
    "infinite target": (P, spoilt(-INF)),
    "beyond squares": (spoilt(1e200), Q),
    "at the end of float64": (P, spoilt(1.7e308)),
    "NaN direction": (P, Q, spoilt(NAN, M), N),
    "infinite direction": (P, Q, M, spoilt(INF, N)),
    "zero direction": (P, Q, 0.0 * M, N),
    "one direction missing": (P, Q, M, N[:-1]),
    "directions on one side": (P, Q, M),
    "one point missing": (P, Q[:-1]),
    "none": (np.zeros((0, 3)), np.zeros((0, 3))),
    "None": (None, None),
    "text": ("points", Q),
    "objects": ([[None] * 3] * 6, Q),
    "complex": (P + 1j, Q),
    "flat": (P.ravel(), Q.ravel()),
    "two columns": (P[:, :2], Q[:, :2]),
    "ragged": ([[1, 2, 3], [1, 2]], Q),
    "one point": (P[:1], Q[:1]),
    "two points": (P[:2], Q[:2]),
    "one place": (np.tile(P[:1], (6, 1)), Q),
    "collinear": (np.outer(np.arange(6), [1, 2, 3]), np.outer(np.arange(6), [1, 2, 3])),
    "negative weight": (P, Q, None, None, [1, 1, 1, 1, 1, -1]),
    "NaN weight": (P, Q, None, None, [1, 1, 1, 1, 1, NAN]),
    "minus infinite weight": (P, Q, None, None, [1, 1, 1, 1, 1, -INF]),
    "one exact point alone": (P[:1], Q[:1], None, None, INF),
    "exact points that contradict": (P, P * [1, 2, 3], None, None, INF),
    "exact direction of length zero": (P, Q, 0.0 * M, N, None, INF),
    "exact directions beyond squares": (P, Q, 1e200 * M, N, None, INF),
    "weights zero": (P, Q, None, None, np.zeros(6)),
    "too few weights": (P, Q, None, None, [1, 1]),
    "text weights": (P, Q, None, None, "even"),
    "weights on two points": (P, Q, None, None, [1, 1, 0, 0, 0, 0]),
}


@pytest.mark.parametrize("solver", [solve, svd, horn, walker1991])
@pytest.mark.parametrize("name", WRONG)
def test_no_solver_takes_what_is_wrong(solver: Callable[..., Any], name: str) -> None:
    with pytest.raises(DqregError):
        solver(*WRONG[name])


@pytest.mark.parametrize("solver", [svd, horn, walker1991, solve_many])
def test_only_solve_takes_an_infinite_weight(solver: Callable[..., Any]) -> None:
    beta = np.array([1.0, 1, 1, 1, 1, INF])
    rows = (P[None], Q[None], None, None, beta[None]) if solver is solve_many else (P, Q, None, None, beta)
    with pytest.raises(InputError, match="infinite"):
        solver(*rows)
    np.testing.assert_allclose(solve(P, Q, None, None, beta).T_target_source, T, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "change",
    [np.float32, np.longdouble, ">f8", object],
    ids=["float32", "long double", "big-endian", "objects"],
)
@pytest.mark.parametrize("solver", [solve, svd, horn, walker1991])
def test_every_kind_of_array_is_read_and_none_is_changed(solver: Callable[..., Any], change: Any) -> None:
    source, target = P.astype(change), np.asfortranarray(Q.astype(change))[::1]
    kept = source.copy(), target.copy()
    source.flags.writeable = target.flags.writeable = False
    found = solver(source, target)
    np.testing.assert_allclose(found.T_target_source, T, atol=1e-5)
    np.testing.assert_array_equal(source, kept[0])
    np.testing.assert_array_equal(target, kept[1])


def test_mirrored_matches_give_a_rotation_all_the_same() -> None:
    for solver in (solve, svd, horn, walker1991):
        R = solver(P * [-1.0, 1.0, 1.0], P).T_target_source[:3, :3]
        assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("bad", [NAN, INF, 1e200])
def test_a_bad_problem_among_many_is_refused_or_marked(bad: float) -> None:
    sources = np.stack([P, spoilt(bad), P])
    try:
        found = solve_many(sources, np.stack([Q, Q, Q]))
    except InputError:
        return
    assert found.degenerate[1]
    np.testing.assert_allclose(found.T_target_source[0], T, atol=1e-12)


CALLS: dict[str, Callable[[], Any]] = {
    "solve_many of nothing": lambda: solve_many(np.zeros((0, 3)), np.zeros((0, 3))),
    "solve_many of text": lambda: solve_many("a", "b"),
    "solve_many ragged": lambda: solve_many([P, P[:3]], [Q, Q[:3]]),
    "likelihood of negative": lambda: likelihood_weights(-1.0, 1.0),
    "likelihood of NaN": lambda: likelihood_weights(NAN, 1.0),
    "likelihood of text": lambda: likelihood_weights("a", 1.0),
    "cost of NaN points": lambda: PoseCost.points(spoilt(NAN), Q),
    "cost of fewer points": lambda: PoseCost.points(P, Q[:2]),
    "cost of zero normals": lambda: PoseCost.planes(P, Q, 0.0 * N),
    "cost of negative weights": lambda: PoseCost.points(P, Q, -np.ones(6)),
    "cost of text": lambda: PoseCost.points("a", "b"),
    "prior of a mirror": lambda: PoseCost.prior(np.diag([1.0, 1, -1, 1]), np.eye(6)),
    "prior without variance": lambda: PoseCost.prior(np.eye(4), np.zeros((6, 6))),
    "prior of NaN": lambda: PoseCost.prior(np.eye(4), np.full((6, 6), NAN)),
    "value at no pose": lambda: PoseCost.points(P, Q).value(np.ones((4, 4))),
    "value at NaN": lambda: PoseCost.points(P, Q).value(np.full((4, 4), NAN)),
    "freedom of nonsense": lambda: Freedom.parse("up"),
    "freedom of a number": lambda: Freedom.parse(3),
    "freedom of None": lambda: Freedom.parse(None),
    "freedom in a mirror": lambda: Freedom.parse("rz", frame=np.diag([1.0, 1, -1, 1])),
    "quaternion of zeros": lambda: quaternion.to_matrix(np.zeros(4)),
    "quaternion of NaN": lambda: quaternion.to_matrix(np.full(4, NAN)),
    "quaternion of three": lambda: quaternion.to_matrix(np.ones(3)),
    "quaternion of text": lambda: quaternion.to_matrix("wxyz"),
    "dual quaternion of a mirror": lambda: DualQuaternion.from_matrix(np.diag([1.0, 1, -1, 1])),
    "dual quaternion of NaN": lambda: DualQuaternion.from_matrix(np.full((4, 4), NAN)),
    "dual quaternion of a scale": lambda: DualQuaternion.from_matrix(np.diag([2.0, 2, 2, 1])),
    "pose of two rows": lambda: pose.apply(np.eye(4)[:2], P),
    "moved text": lambda: pose.apply(np.eye(4), "points"),
    "moved two columns": lambda: pose.apply(np.eye(4), P[:, :2]),
    "target of None": lambda: dqreg.prepare_target(None),
    "target of two points": lambda: dqreg.prepare_target(P[:2]),
    "target of a line": lambda: dqreg.prepare_target(np.outer(np.arange(6.0), [1, 2, 3])),
    "target of nowhere": lambda: dqreg.prepare_target("nowhere.stl"),
    "depth of text": lambda: dqreg.PointCloud.from_depth("image", (1, 1, 0, 0)),
    "depth of nothing": lambda: dqreg.PointCloud.from_depth(np.zeros((4, 4)), (1.0, 1.0, 0.0, 0.0)),
    "depth of NaN": lambda: dqreg.PointCloud.from_depth(np.full((4, 4), NAN), (1.0, 1.0, 0.0, 0.0)),
    "depth of one axis": lambda: dqreg.PointCloud.from_depth(np.ones(4), (1.0, 1.0, 0.0, 0.0)),
    "depth by a camera of zeros": lambda: dqreg.PointCloud.from_depth(np.ones((9, 9)), (0.0, 0.0, 0.0, 0.0)),
    "depth by a camera of NaN": lambda: dqreg.PointCloud.from_depth(np.ones((9, 9)), (NAN, 1.0, 0.0, 0.0)),
    "depth by a camera of text": lambda: dqreg.PointCloud.from_depth(np.ones((9, 9)), "camera"),
    "depth by steps of zero": lambda: dqreg.PointCloud.from_depth(np.ones((9, 9)), (9.0, 9.0, 4.0, 4.0), stride=0),
    "depth by a scale of zero": lambda: dqreg.PointCloud.from_depth(
        np.ones((9, 9)), (9.0, 9.0, 4.0, 4.0), depth_scale=0.0
    ),
    "depth cut at NaN": lambda: dqreg.PointCloud.from_depth(np.ones((9, 9)), (9.0, 9.0, 4.0, 4.0), depth_trunc=NAN),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_call_ends_in_a_named_error(name: str) -> None:
    with pytest.raises(DqregError):
        CALLS[name]()
