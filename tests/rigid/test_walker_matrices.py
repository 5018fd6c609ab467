"""Table 2 and the matrix forms of Walker, Shao and Volz, in their own order (vector, then scalar)."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings

from dqreg.rigid import DualQuaternion
from dqreg.rigid import quaternion as quat
from tests.strategies import poses, quaternions, unit_quaternions

fast = settings(deadline=None, max_examples=40)
LAST = [1, 2, 3, 0]  # scalar first to scalar last
E = np.array([0.0, 0.0, 0.0, 1.0])
EPS = 1e-14


def paper(q):
    return np.asarray(q)[LAST]


def ours(q):
    return np.asarray(q)[[3, 0, 1, 2]]


def QM(a):
    return quat.left_matrix(ours(a))[np.ix_(LAST, LAST)]


def WM(a):
    return quat.right_matrix(ours(a))[np.ix_(LAST, LAST)]


@fast
@given(quaternions())
def test_equations_15_and_16_as_printed(a):
    # Walker eqs. 2 and 15, 16.
    r, r4, K = a[:3], a[3], quat.cross_matrix(a[:3])
    top = r[:, None]
    np.testing.assert_array_equal(QM(a), np.block([[r4 * np.eye(3) + K, top], [-r, r4]]))
    np.testing.assert_array_equal(WM(a), np.block([[r4 * np.eye(3) - K, top], [-r, r4]]))


@fast
@given(quaternions(), quaternions())
def test_table_2(a, b):
    aa, bb = a @ a, b @ b
    eye, ab = np.eye(4), np.sqrt(aa * bb)
    for M in (QM, WM):
        np.testing.assert_allclose(M(a).T @ M(a), aa * eye, rtol=0, atol=EPS * aa)
        np.testing.assert_allclose(M(a) @ M(a).T, aa * eye, rtol=0, atol=EPS * aa)
        np.testing.assert_allclose(M(a).T @ a, aa * E, rtol=0, atol=EPS * aa)
        np.testing.assert_allclose(M(M(a) @ b), M(a) @ M(b), rtol=0, atol=EPS * ab)
    np.testing.assert_allclose(QM(a) @ b, WM(b) @ a, rtol=0, atol=EPS * ab)
    np.testing.assert_allclose(QM(a) @ WM(b).T, WM(b).T @ QM(a), rtol=0, atol=EPS * ab)


@fast
@given(unit_quaternions())
def test_equations_4_17_and_18(q):
    # Walker eqs. 4 and 17, 18.
    r = paper(q)
    R = (r[3] ** 2 - r[:3] @ r[:3]) * np.eye(3) + 2 * np.outer(r[:3], r[:3]) + 2 * r[3] * quat.cross_matrix(r[:3])
    np.testing.assert_allclose(quat.to_matrix(q), R, atol=1e-15)
    joint = np.eye(4)
    joint[:3, :3] = R
    np.testing.assert_allclose(WM(r).T @ QM(r), joint, atol=EPS)


@fast
@given(poses())
def test_equations_19_20_25_and_67_to_69(T):
    # Walker eqs. 19, 20, 25 and 67 to 69.
    q = DualQuaternion.from_matrix(T)
    r, s, t = paper(q.real), paper(q.dual), np.array([*(T[:3, 3] / 2), 0.0])  # eqs. 20 and 68
    scale = EPS * (1 + np.linalg.norm(t))
    np.testing.assert_allclose(WM(r).T @ s, t, rtol=0, atol=scale)  # eqs. 19 and 69
    np.testing.assert_allclose(WM(r) @ t, s, rtol=0, atol=scale)  # eq. 25
    by_67 = 2 * (r[3] * s[:3] - s[3] * r[:3] + np.cross(r[:3], s[:3]))
    np.testing.assert_allclose(by_67, T[:3, 3], rtol=0, atol=4 * scale)
    np.testing.assert_allclose(q.translation, by_67, rtol=0, atol=4 * scale)
