from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.icp.correspondences import Correspondences
from dqreg.icp.rejectors import NormalAngle, Robust, Trimmed, WithinDistance, product
from dqreg.solvers.robust import Huber, InlierMixture
from tests.icp.scenes import pairs_at

DISTANCES = st.lists(st.floats(0.0, 100.0), min_size=1, max_size=30).map(np.array)


def pairs_with_normals(source: np.ndarray, target: np.ndarray, same_sign: bool) -> Correspondences:
    bare = pairs_at(np.zeros(len(source)))
    scan, closest = (dataclasses.replace(part, normals=n) for part, n in ((bare.scan, source), (bare.closest, target)))
    return dataclasses.replace(bare, scan=scan, closest=closest, same_sign=same_sign)


@settings(deadline=None, max_examples=50)
@given(DISTANCES, st.floats(0.0, 100.0))
def test_within_distance_keeps_what_is_at_the_limit_and_nothing_beyond(d: np.ndarray, limit: float) -> None:
    assert WithinDistance(limit)(pairs_at(d)).tolist() == [1.0 if x <= limit else 0.0 for x in d]
    assert WithinDistance(d.max())(pairs_at(d)).all()


def test_the_angle_of_normals_with_known_signs_counts_up_to_a_half_turn() -> None:
    angles_rad = np.deg2rad([0.0, 29.9, 30.1, 90.0, 150.0, 180.0])
    source = np.column_stack([np.cos(angles_rad), np.sin(angles_rad), np.zeros(6)])
    target = np.tile([1.0, 0.0, 0.0], (6, 1))
    rejector = NormalAngle(np.deg2rad(30.0))
    assert rejector(pairs_with_normals(source, target, same_sign=True)).tolist() == [1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    # Of lines, 150 degrees is 30 and 180 is none.
    lines = pairs_with_normals(source, target, same_sign=False)
    assert NormalAngle(np.deg2rad(30.1))(lines).tolist() == [1.0, 1.0, 1.0, 0.0, 1.0, 1.0]
    assert NormalAngle(np.pi / 2)(lines).all()


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 1.57))
def test_the_sign_of_unknown_normals_has_no_say(seed: int, limit_rad: float) -> None:
    rng = np.random.default_rng(seed)
    source, target = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.standard_normal((2, 10, 3)))
    signs = rng.choice([-1.0, 1.0], (10, 1))
    rejector = NormalAngle(limit_rad)
    plain = rejector(pairs_with_normals(source, target, same_sign=False))
    np.testing.assert_array_equal(rejector(pairs_with_normals(signs * source, target, same_sign=False)), plain)
    np.testing.assert_array_equal(rejector(pairs_with_normals(source, signs * target, same_sign=False)), plain)


@pytest.mark.parametrize("same_sign", [True, False])
def test_pairs_without_a_normal_pass_the_angle(same_sign: bool) -> None:
    up, side, none = [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    pairs = pairs_with_normals(np.array([up, none, up, none]), np.array([side, up, none, none]), same_sign)
    assert NormalAngle(0.5)(pairs).tolist() == [0.0, 1.0, 1.0, 1.0]


def test_robust_is_its_kernel() -> None:
    d = np.array([0.0, 0.5, 3.0])
    np.testing.assert_array_equal(Robust(Huber(1.0))(pairs_at(d)), Huber(1.0).weight(d))


@settings(deadline=None, max_examples=50)
@given(DISTANCES, st.floats(0.0, 1.0))
def test_trimmed_keeps_exactly_its_share_and_the_closest(d: np.ndarray, share: float) -> None:
    weights = Trimmed(share)(pairs_at(d))
    assert set(weights) <= {0.0, 1.0}
    assert weights.sum() == np.ceil(share * len(d))
    kept, dropped = d[weights > 0.0], d[weights == 0.0]
    assert kept.max(initial=0.0) <= dropped.min(initial=np.inf)


def test_trimmed_breaks_ties_by_order() -> None:
    assert Trimmed(0.5)(pairs_at(np.ones(6))).tolist() == [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]


@settings(deadline=None, max_examples=30)
@given(DISTANCES)
def test_factors_multiply_in_any_order_and_zero_rejects(d: np.ndarray) -> None:
    pairs = pairs_at(d)
    factors = [WithinDistance(50.0), Robust(InlierMixture(5.0, 0.7, 60.0)), Trimmed(0.6)]
    expected = np.prod([factor(pairs) for factor in factors], axis=0)
    np.testing.assert_allclose(product(factors, pairs), expected, rtol=1e-15)
    np.testing.assert_allclose(product(factors[::-1], pairs), expected, rtol=1e-15)
    assert not product(factors, pairs)[d > 50.0].any()


def test_no_factors_are_ones_and_no_pairs_are_nothing() -> None:
    assert product((), pairs_at(np.ones(3))).tolist() == [1.0, 1.0, 1.0]
    nothing = pairs_at(np.zeros(0))
    for factor in (WithinDistance(1.0), NormalAngle(1.0), Robust(Huber(1.0)), Trimmed(0.5)):
        assert product([factor], nothing).shape == (0,)
