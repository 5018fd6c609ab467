from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid import pose
from dqreg.solvers import horn, solve, solve_many, svd, walker1991
from tests.solvers.problems import TETRAHEDRON

# A quarter turn about z, and a shift: exact in binary.
QUARTER = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
LINE = np.outer([0.0, 1, 2, 5], [1.0, 2, -2])
SPOT = np.tile([1.0, 2, 3], (5, 1))
# One place, but for the last bit of some coordinates.
GRAIN = 1e6 / 7 * (1 + np.finfo(float).eps * np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]]))
DEGENERATE = {
    "line": (LINE, LINE + 1),
    "far line": (LINE + 1e6, LINE + 1e6),
    "two points": (TETRAHEDRON[:2], TETRAHEDRON[:2]),
    "one point": ([[1, 2, 3]], [[4, 5, 6]]),
    "one place": (SPOT, SPOT),
    "one far place": (SPOT * 123456.789, SPOT * 654321.987),
    "one place on one side": (TETRAHEDRON, SPOT[:4] * 0.1),
    "one place but for rounding": (GRAIN, TETRAHEDRON),
    "one place but for rounding on the other side": (TETRAHEDRON, GRAIN),
    "one place at the origin": (np.zeros((4, 3)), TETRAHEDRON),
    "direction along the line": (LINE, LINE, LINE[1:2] / 3, LINE[1:2] / 3),
    "one direction at one place": (SPOT * 1e6 / 7, SPOT * 1e6 / 7, [[0, 0, 1]], [[0, 0, 1]]),
    "no weight": (TETRAHEDRON, TETRAHEDRON, None, None, 0.0),
    "weight on a line only": (TETRAHEDRON, TETRAHEDRON, None, None, [1, 1, 0, 0]),
    "directions alone": (np.zeros((0, 3)), np.zeros((0, 3)), np.eye(3), np.eye(3)),
    "directions and weightless points": (TETRAHEDRON, TETRAHEDRON, np.eye(3), np.eye(3), [0, 0, 0, 0]),
}


@pytest.mark.parametrize("solver", [solve, svd, horn, walker1991])
@pytest.mark.parametrize("case", DEGENERATE)
def test_what_leaves_the_pose_free_raises_with_the_gap(solver, case):
    with pytest.raises(DegenerateGeometryError, match="gap"):
        solver(*DEGENERATE[case])


OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])
# Each cause with its own sentence and remedy.
CAUSES = {
    "too few": ((TETRAHEDRON[:2], TETRAHEDRON[:2]), "2 points and 0 directions; at least three points"),
    "too few by weight": ((TETRAHEDRON, TETRAHEDRON, None, None, [1, 1, 0, 0]), "2 points and 0 directions"),
    "one point, one direction": (([[1, 2, 3]], [[4, 5, 6]], [[0, 0, 1]], [[0, 0, 1]]), "1 point and 1 direction;"),
    "a line": ((LINE, LINE), "lie on one line, and no direction across it: add a point off that line"),
    "one place": ((SPOT, SPOT), "lie in one place: add points elsewhere"),
    "reversed directions": ((SPOT[:1], SPOT[:1], np.eye(3), -np.eye(3)), "reversed: check the handedness"),
    "a mirror image": ((OCTAHEDRON, -OCTAHEDRON), "mirror image of the other"),
    "far": ((TETRAHEDRON * 0.05 + 1e14, TETRAHEDRON + 1e14), "Subtract a common offset"),
}


@pytest.mark.parametrize("solver", [solve, svd, horn, walker1991])
@pytest.mark.parametrize("case", CAUSES)
def test_each_cause_has_its_own_sentence(solver, case):
    arguments, words = CAUSES[case]
    with pytest.raises(DegenerateGeometryError, match=words):
        solver(*arguments)


def test_a_weight_too_small_is_the_cause_that_is_named():
    across = np.array([[2.0, 1, 2]]) / 3
    for solver, alpha in ((solve, 1e-22), (svd, 1e-14), (horn, 1e-14), (walker1991, 1e-14)):
        with pytest.raises(DegenerateGeometryError, match=r"too little weight .*direction_weights"):
            solver(LINE, LINE, across, across, None, alpha)
        # Equal weights do what the message promises.
        solver(LINE, LINE, across, across)


def test_the_published_sums_far_from_the_origin_are_told_from_a_line():
    points = TETRAHEDRON + 1e8
    solve(points, points)
    with pytest.raises(DegenerateGeometryError, match="from the origin and extend over"):
        walker1991(points, points)


@pytest.mark.parametrize("scale", [1e-150, 1e-158, 1e-160, 1e-170, 1e-300])
def test_lengths_too_small_to_be_squared_are_named(scale):
    q = pose.apply(QUARTER, TETRAHEDRON) * scale
    with pytest.raises(InputError, match="finer unit"):
        solve(TETRAHEDRON * scale, q)
    assert solve_many([TETRAHEDRON * scale, TETRAHEDRON], [q, TETRAHEDRON]).degenerate.tolist() == [True, False]


@pytest.mark.parametrize("solver", [solve, svd, horn])
@pytest.mark.parametrize("weight", [1e-300, 1e-150, 1e150, 1e160, 1e300])
def test_weights_of_any_size_give_the_pose(solver, weight):
    q = pose.apply(QUARTER, TETRAHEDRON)
    fit = solver(TETRAHEDRON, q, point_weights=weight)
    np.testing.assert_allclose(fit.T_target_source, QUARTER, rtol=0, atol=1e-14)
    assert fit.rms < 1e-14


def test_a_short_line_far_away_is_no_wider_than_its_rounding():
    # 1.5e-6 long and 4e5 away: the coordinates' own rounding makes it 1e-11 wide.
    line = LINE * 1e-7 + [1e6 / 7, 1e6 / 3, 1e6 / 11]
    with pytest.raises(DegenerateGeometryError):
        solve(line, line)
    assert solve_many(line[None], line[None]).degenerate.all()


def test_many_points_on_a_far_line_raise():
    steps = np.random.default_rng(0).uniform(-1, 1, 10_000)
    line = steps[:, None] * [1.0, 2.0, 3.0] + 1e6
    with pytest.raises(DegenerateGeometryError):
        solve(line, line)


ENOUGH = {
    "plane": (TETRAHEDRON * [1, 1, 0],),
    "three points": (TETRAHEDRON[:3],),
    "two points and a direction across": (TETRAHEDRON[:2], [[0, 0, 1.0]]),
    "one point and two directions": (TETRAHEDRON[:1], [[0, 0, 1.0], [0, 1, 0]]),
    "one place and two directions": (SPOT, [[0, 0, 1.0], [0, 1, 0]]),
    "a billionth in size": (TETRAHEDRON * 1e-9,),
    "a square": (np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]),),
    "a strip a hundred times as long as wide": (TETRAHEDRON * [1, 0.01, 0],),
}


@pytest.mark.parametrize("solver", [solve, svd, horn, walker1991])
@pytest.mark.parametrize("case", ENOUGH)
def test_what_is_enough_gives_the_pose(solver, case):
    points, *rest = ENOUGH[case]
    directions = (rest[0], pose.rotate(QUARTER, rest[0])) if rest else ()
    T = QUARTER.copy()
    T[:3, 3] *= np.abs(points).max()
    fit = solver(points, pose.apply(T, points), *directions)
    np.testing.assert_allclose(fit.T_target_source[:3, :3], T[:3, :3], rtol=0, atol=1e-11)
    np.testing.assert_allclose(fit.T_target_source[:3, 3], T[:3, 3], rtol=0, atol=1e-10 * np.abs(points).max())


NAN, INF = float("nan"), float("inf")
P = TETRAHEDRON
BAD = {
    "NaN point": ((P * [1, NAN, 1], P), "points_source holds 4 numbers"),
    "infinite point": ((P, np.add(P, [INF, 0, 0])), "points_target holds 4 numbers"),
    "NaN direction": ((P, P, [[0, 0, 1]], [[0, NAN, 1]]), "directions_target holds 1"),
    "NaN weight": ((P, P, None, None, [1, 1, 1, NAN]), "point_weights holds 1"),
    "negative weight": ((P, P, None, None, [1, 1, 1, -2]), "must not be negative; the smallest is -2"),
    "negative direction weight": ((P, P, P, P, None, -1.0), "direction_weights must not be negative"),
    "too few weights": ((P, P, None, None, [1, 1]), "4 numbers"),
    "different counts": ((P, P[:3]), "4 rows and points_target 3"),
    "different direction counts": ((P, P, P, P[:2]), "4 rows and directions_target 2"),
    "one side of directions": ((P, P, P), "directions_target is missing"),
    "other side of directions": ((P, P, None, P), "directions_source is missing"),
    "weights without directions": ((P, P, None, None, None, [1.0]), "without directions"),
    "wrong shape": ((P[:, :2], P[:, :2]), r"shape \(n, 3\)"),
    "flat": (([1, 2, 3], [1, 2, 3]), r"shape \(n, 3\)"),
    "words": ((["a"], ["b"]), "real numbers"),
    "nothing": ((np.zeros((0, 3)), np.zeros((0, 3))), "no rows"),
    "zero direction": ((P, P, [[0, 0, 1], [0, 0, 0]], [[0, 0, 1], [0, 1, 0]]), "length zero, the first in row 1"),
    "zero weighted direction": ((P, P, np.eye(3), np.zeros((3, 3)), None, [0.1, 3, 1]), "3 directions of length zero"),
}


@pytest.mark.parametrize("solver", [solve, svd, horn, walker1991])
@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_named(solver, case):
    arguments, words = BAD[case]
    with pytest.raises(InputError, match=words):
        solver(*arguments)


def test_squares_that_overflow_are_named():
    with pytest.raises(InputError, match="larger unit"):
        solve(P * 1e200, P * 1e200)


@pytest.mark.parametrize("bad", [NAN, INF])
@pytest.mark.parametrize("side", [0, 1, 2, 3])
def test_one_bad_number_among_many_is_found(side, bad):
    rng = np.random.default_rng(5)
    rows = [rng.normal(size=(9000, 3)) for _ in range(4)]
    rows[side][7000, 1] = bad
    with pytest.raises(InputError, match=r"1 numbers that are NaN or infinite, the first at \(7000, 1\)"):
        solve(*rows)


def test_one_zero_direction_among_many_is_found():
    p = np.random.default_rng(5).normal(size=(9000, 3))
    m = p / np.linalg.norm(p, axis=1, keepdims=True)
    n = m.copy()
    n[4321] = 0.0
    with pytest.raises(InputError, match="row 4321"):
        solve(p, p, m, n)
