"""Stacks of dual quaternions: every function gives, for each item, what it gives for that item alone."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.rigid import DualNumber, DualQuaternion, lines, pose

RNG = np.random.default_rng(0)
SHAPE = (5, 3)
MATRICES, OTHERS = (pose.random(RNG, reach=10.0, shape=SHAPE) for _ in range(2))
# Rotations that a formula with a quotient would lose: none, tiny, a half-turn; and no translation.
MATRICES[0, 0] = np.eye(4)
MATRICES[0, 1] = pose.exp([0, 0, 0, 1, 2, 3])
MATRICES[0, 2] = pose.exp([0, 1e-9, 0, 1, 2, 3])
MATRICES[1, 0] = pose.exp([np.pi, 0, 0, 1, 2, 3])
MATRICES[1, 1] = pose.exp([0.3, 0.2, 0.1, 0, 0, 0])
STACK, OTHER = DualQuaternion.from_matrix(MATRICES), DualQuaternion.from_matrix(OTHERS)
FRACTIONS = RNG.uniform(-1, 2, SHAPE)
VECTORS = RNG.standard_normal((*SHAPE, 3))
LINES = lines.through(RNG.standard_normal((*SHAPE, 3)), VECTORS)
PLANES = RNG.standard_normal((*SHAPE, 4))

# What one motion does, with the item's own arguments.
FUNCTIONS = {
    "product": lambda q, k: (q * OTHER[k]).as_array(),
    "sum": lambda q, k: (q + OTHER[k]).as_array(),
    "difference": lambda q, k: (q - OTHER[k]).as_array(),
    "multiple": lambda q, k: (FRACTIONS[k] * q).as_array(),
    "negative": lambda q, k: (-q).as_array(),
    "normalized": lambda q, k: (q + 0.5 * OTHER[k]).normalized().as_array(),
    "inverse": lambda q, k: q.inverse().as_array(),
    "inverse of a sum": lambda q, k: (q + 0.5 * OTHER[k]).inverse().as_array(),
    "conjugates": lambda q, k: [q.quaternion_conjugate().real, q.dual_conjugate().dual, q.combined_conjugate().dual],
    "canonical": lambda q, k: (-q).canonical().as_array(),
    "log": lambda q, k: q.log(),
    "exp": lambda q, k: DualQuaternion.exp(q.log()).as_array(),
    "power": lambda q, k: (q ** FRACTIONS[k]).as_array(),
    "long power": lambda q, k: (-q).power(FRACTIONS[k], shorter_turn=False).as_array(),
    "sclerp": lambda q, k: q.sclerp(OTHER[k], FRACTIONS[k]).as_array(),
    "screw": lambda q, k: q.as_screw(),
    "matrix": lambda q, k: q.as_matrix(),
    "translation": lambda q, k: q.translation,
    "norm": lambda q, k: [(q + OTHER[k]).norm().real, (q + OTHER[k]).norm().dual],
    "residuals": lambda q, k: (q + OTHER[k]).constraint_residuals(),
    "points": lambda q, k: q.apply(VECTORS[k]),
    "directions": lambda q, k: q.rotate(VECTORS[k]),
    "lines": lambda q, k: q.move_lines(LINES[k]),
    "planes": lambda q, k: q.move_planes(PLANES[k]),
    "close": lambda q, k: q.isclose(q * OTHER[k]),
}  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_stack_is_its_items(name):
    function = FUNCTIONS[name]
    whole = function(STACK, (...,))
    for k in np.ndindex(SHAPE):
        one = function(STACK[k], k)
        pairs = zip(whole, one, strict=True) if isinstance(whole, (list, tuple)) else [(whole, one)]
        for many, single in pairs:
            np.testing.assert_allclose(many[k], single, rtol=0, atol=1e-13, err_msg=f"{name} of {k}")


def test_the_answers_are_those_of_4x4_matrices():
    # The oracle is another representation; translations are up to 20 and rounding with them.
    close = {"rtol": 0, "atol": 1e-13}
    np.testing.assert_allclose(STACK.as_matrix(), MATRICES, **close)
    np.testing.assert_allclose((STACK * OTHER).as_matrix(), MATRICES @ OTHERS, **close)
    np.testing.assert_allclose(STACK.inverse().as_matrix(), pose.inverse(MATRICES), **close)
    np.testing.assert_allclose(STACK.log()[1:], pose.log(MATRICES)[1:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(DualQuaternion.exp(STACK.log()).as_matrix(), MATRICES, rtol=0, atol=1e-13)
    np.testing.assert_allclose(STACK.apply(VECTORS), pose.apply(MATRICES, VECTORS), **close)
    np.testing.assert_allclose(STACK.rotate(VECTORS), pose.rotate(MATRICES, VECTORS), **close)
    np.testing.assert_allclose(STACK.move_lines(LINES), pose.move_lines(MATRICES, LINES), **close)
    np.testing.assert_allclose(STACK.move_planes(PLANES), pose.move_planes(MATRICES, PLANES), **close)


def test_a_moved_line_and_a_moved_plane_hold_the_moved_points():
    p, n = LINES[..., 3:] * 0 + 7.0, VECTORS
    line, moved = lines.through(p, n), STACK.apply(p + 2.5 * n)
    there = STACK.move_lines(line)
    np.testing.assert_allclose(np.cross(moved, there[..., :3]), there[..., 3:], rtol=0, atol=1e-12)
    plane = np.concatenate([n, -np.sum(n * p, axis=-1, keepdims=True)], axis=-1)
    there = STACK.move_planes(plane)
    np.testing.assert_allclose(np.sum(there[..., :3] * STACK.apply(p), -1) + there[..., 3], 0, atol=1e-12)


def test_leading_axes_broadcast():
    column = STACK[:, :1]
    assert column.shape == (5, 1)
    assert (column * OTHER[0]).shape == (5, 3)
    np.testing.assert_allclose((column * OTHER[0])[4, 2].as_array(), (STACK[4, 0] * OTHER[0, 2]).as_array())
    cloud = RNG.standard_normal((7, 3))
    each = STACK[:, 0][:, None].apply(cloud)
    assert each.shape == (5, 7, 3)
    np.testing.assert_allclose(each[3], pose.apply(MATRICES[3, 0], cloud), atol=1e-13)
    np.testing.assert_allclose(pose.apply(MATRICES[:, 0][:, None], cloud), each, atol=1e-13)
    path = STACK[2, 0].sclerp(OTHER[2, 0], np.linspace(0, 1, 11))
    assert path.shape == (11,)
    np.testing.assert_allclose(path[4].as_array(), STACK[2, 0].sclerp(OTHER[2, 0], 0.4).as_array(), atol=1e-14)
    screw = DualQuaternion.from_screw([0, 0, 1], [0.1, 0.2], 3.0, [1, 0, 0]).as_screw()
    np.testing.assert_allclose(screw.angle_rad, [0.1, 0.2])
    np.testing.assert_allclose(screw.point, [[1, 0, 0]] * 2, atol=1e-14)
    assert DualQuaternion.identity((2, 3)).shape == (2, 3)
    assert DualQuaternion(np.eye(4)[0], np.zeros((6, 4))).shape == (6,)


def test_a_stack_is_taken_apart():
    assert len(STACK) == 5
    assert [row.shape for row in STACK] == [(3,)] * 5
    assert STACK[1, 2] == DualQuaternion(STACK.real[1, 2], STACK.dual[1, 2])
    assert STACK[..., 0] == STACK[:, 0]
    assert STACK[FRACTIONS > 0.5].shape == (np.count_nonzero(FRACTIONS > 0.5),)
    single = STACK[0, 0]
    assert single
    with pytest.raises(TypeError, match="no items"):
        single[0]
    with pytest.raises(TypeError, match="no length"):
        len(single)
    with pytest.raises(IndexError):
        STACK[7]


def test_equal_by_value_and_close_as_motions():
    q = STACK[4, 1]
    twin = DualQuaternion(q.real, q.dual)
    assert q == twin
    assert hash(q) == hash(twin)
    assert q != -q
    assert q != STACK
    assert q != "q"
    assert len({q, twin, -q}) == 2
    assert q.isclose(-q)
    turned = q * DualQuaternion.exp([1e-6, 0, 0, 0, 0, 0])
    assert not q.isclose(turned)
    assert q.isclose(turned, angle_rad=2e-6, distance=1e-4)
    moved = DualQuaternion.exp([0, 0, 0, 1e-6, 0, 0]) * q
    assert not q.isclose(moved)
    assert q.isclose(moved, distance=2e-6)
    # The default distance follows the translation: in other units the answer is the same.
    for unit in (1e-6, 1.0, 1e6):
        a, b = (DualQuaternion.exp([0.1, 0, 0, 0, 0, unit * (1 + error)]) for error in (0.0, 5e-10))
        c = DualQuaternion.exp([0.1, 0, 0, 0, 0, unit * (1 + 2e-9)])
        assert (a.isclose(b), a.isclose(c)) == (True, False)


def test_sums_are_no_motions_until_normalized():
    a, b = STACK[2], OTHER[2]
    total = 0.25 * a + b / 2.0
    assert not total.is_unit
    assert total.normalized().is_unit
    assert a.is_unit
    for use in (total.as_matrix, total.log, total.as_screw, lambda: total.apply([1, 2, 3]), lambda: total**2):
        with pytest.raises(InputError, match="normalized"):
            use()
    np.testing.assert_allclose(
        (total.inverse() * total).as_array(), DualQuaternion.identity((3,)).as_array(), atol=1e-14
    )
    # Every scale stands for the same motion; the norm is the product's.
    np.testing.assert_allclose((1e-200 * a).normalized().as_matrix(), a.as_matrix(), atol=1e-12)
    product, single = (total * a).norm(), total.norm()
    np.testing.assert_allclose(product.real, single.real, atol=1e-15)
    np.testing.assert_allclose(product.dual, single.dual, atol=1e-14)
    with pytest.raises(InputError, match="cannot be normalized"):
        (a - a).normalized()
    # A multiple that ends at norm 1 is a motion again.
    assert (2.0 * a * 0.5).as_matrix().shape == (3, 4, 4)


def test_eight_numbers_there_and_back():
    numbers = STACK.as_array()
    assert DualQuaternion.from_array(numbers) == STACK
    last = STACK.as_array(scalar_first=False)
    np.testing.assert_array_equal(last[..., [3, 0, 1, 2, 7, 4, 5, 6]], numbers)
    assert DualQuaternion.from_array(last, scalar_first=False) == STACK
    rounded = numbers.astype(np.float32)
    with pytest.raises(InputError, match="normalize=True"):
        DualQuaternion.from_array(rounded)
    mended = DualQuaternion.from_array(rounded, normalize=True)
    assert np.all(mended.isclose(STACK, angle_rad=1e-6, distance=1e-5))
    with pytest.raises(InputError, match="eight"):
        DualQuaternion.from_array(numbers[..., :7])


def test_one_rule_for_the_shorter_way():
    from dqreg import quaternion

    # 200 degrees about z: half of it by the shorter rotation are -80, by the signs as given 100.
    long = DualQuaternion.from_screw([0, 0, 1], np.deg2rad(200), 4.0)
    one = DualQuaternion.identity()
    for q in (long, -long):
        short = [q**0.5, q.power(0.5), one.sclerp(q, 0.5)]
        angles = [np.rad2deg(each.as_screw().angle_rad) for each in short]
        angles.append(np.rad2deg(2 * np.arccos(abs(quaternion.slerp(one.real, q.real, 0.5)[0]))))
        np.testing.assert_allclose(angles, 80, atol=1e-12)
    given = [long.power(0.5, shorter_turn=False), one.sclerp(long, 0.5, shorter_turn=False)]
    np.testing.assert_allclose([np.rad2deg(each.as_screw().angle_rad) for each in given], 100, atol=1e-12)
    np.testing.assert_allclose([each.as_screw().distance for each in given], 2.0, atol=1e-12)
    np.testing.assert_allclose(
        quaternion.slerp(one.real, long.real, 0.5, shorter_turn=False), given[0].real, atol=1e-15
    )
    # At exactly half a turn either sign gives the same way.
    half = np.array([0.0, 0.0, 0.6, -0.8])
    for sign in (1, -1):
        q = DualQuaternion(sign * half, np.zeros(4))
        axis = (q**0.5).as_screw().axis
        np.testing.assert_allclose(axis, [0, 0.6, -0.8], atol=1e-15)
        np.testing.assert_allclose(quaternion.slerp(one.real, q.real, 0.5), (q**0.5).real, atol=1e-15)
    # A full turn, with the sign that says so, is about the line along which it moves.
    full = -DualQuaternion.exp([0, 0, 0, 0, 3, 0])
    quarter = full.power(0.25, shorter_turn=False).as_screw()
    np.testing.assert_allclose([quarter.angle_rad, quarter.distance], [np.pi / 2, 0.75], atol=1e-14)
    np.testing.assert_allclose(quarter.axis, [0, 1, 0], atol=1e-14)


def test_the_exponential_keeps_its_digits_at_small_angles():
    # Against the series of the exponential of the 4x4 matrix, in long double; the bound is a few rounding steps.
    for angle in (1e-12, 1e-6, 1e-3, 0.1, 0.45, 0.55, 1.0, 2.0, 3.1):
        twist = np.array([angle * 0.6, 0.0, angle * 0.8, 1.0, 2.0, 3.0])
        M = np.zeros((4, 4), dtype=np.longdouble)
        M[:3, :3] = [[0, -twist[2], twist[1]], [twist[2], 0, -twist[0]], [-twist[1], twist[0], 0]]
        M[:3, 3] = twist[3:]
        term = total = np.eye(4, dtype=np.longdouble)
        for k in range(1, 60):
            term = term @ M / k
            total = total + term
        q = DualQuaternion.exp(twist)
        np.testing.assert_allclose(q.as_matrix(), total.astype(float), rtol=0, atol=2e-15)
        np.testing.assert_allclose(q.log(), twist, rtol=0, atol=4e-15)


@pytest.mark.parametrize(
    "use",
    [
        lambda: STACK * OTHER[:2],
        lambda: STACK + OTHER[:2],
        lambda: STACK.apply(np.zeros((4, 3))),
        lambda: STACK.rotate(np.zeros((4, 3))),
        lambda: STACK**FRACTIONS[:2],
        lambda: STACK * FRACTIONS[:2],
        lambda: STACK.isclose(OTHER[:2]),
        lambda: pose.apply(MATRICES, np.zeros((4, 3))),
    ],
)  # fmt: skip
def test_shapes_that_do_not_meet_are_named(use):
    with pytest.raises(InputError, match="must broadcast"):
        use()


def test_bad_items_are_named():
    worn = MATRICES.copy()
    worn[3, 1, :3, :3] *= 1.1
    with pytest.raises(InputError, match="T_target_source"):
        DualQuaternion.from_matrix(worn)
    numbers = STACK.as_array()
    numbers[2, 1, 0] += 1e-3
    with pytest.raises(InputError, match=r"\(2, 1\)"):
        DualQuaternion.from_array(numbers)
    # Worn within the tolerance: brought to a rotation, as a single one is.
    worn = MATRICES.copy()
    worn[3, 1, :3, :3] *= 1 + 1e-6
    np.testing.assert_allclose(DualQuaternion.from_matrix(worn).as_matrix(), MATRICES, atol=1e-12)
    transposed = np.swapaxes(MATRICES, -1, -2)
    with pytest.raises(InputError, match="transposed"):
        DualQuaternion.from_matrix(transposed)


def test_dual_numbers_take_arrays_and_real_numbers():
    a, b = DualNumber(np.array([2.0, 3.0]), np.array([5.0, 7.0])), DualNumber(4.0, 0.5)
    assert (a / b) * b == a
    assert a * 2.0 == 2.0 * a == a + a
    assert 1.0 / b == DualNumber(0.25, -0.5 / 16)
    assert -b == 0.0 - b == DualNumber(-4.0, -0.5)
    assert b - 1.0 == DualNumber(3.0, 0.5)
    assert np.array([1.0, 2.0]) * b == DualNumber(np.array([4.0, 8.0]), np.array([0.5, 1.0]))
    back = a.sin().arctan2(a.cos())
    np.testing.assert_allclose([back.real, back.dual], [a.real, a.dual])
    assert b.exp().dual == pytest.approx(0.5 * np.exp(4.0))
    with pytest.raises(InputError, match="no inverse"):
        b / DualNumber(0.0, 1.0)
    with pytest.raises(InputError, match="no angle"):
        DualNumber(0.0, 1.0).arctan2(DualNumber(0.0, 1.0))
