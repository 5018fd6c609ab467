"""`PoseCost.minimise` with locked motions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg.errors import DegenerateGeometryError
from dqreg.rigid import pose
from dqreg.solvers import Freedom, PoseCost
from dqreg.solvers.dof_words import WORDS
from tests.solvers.cost_cases import GROUPS, SUBSETS, frames, freedoms, mixed
from tests.solvers.problems import fast

EACH = pytest.mark.parametrize("words", SUBSETS, ids=lambda words: " ".join(words) or "none")


@EACH
def test_the_answer_is_allowed_and_no_allowed_pose_near_it_is_better(words: tuple[str, ...]) -> None:
    from scipy.optimize import minimize

    case, freedom = mixed(1, 0.8, noise=0.2), Freedom.only(*words, frame=frames(4))
    reference = case.truth @ pose.exp([0.2, -0.1, 0.1, 0.3, 0.1, -0.2])
    fit = case.cost.minimise(near=reference, dof=freedom)
    free = np.array([word in words for word in WORDS])
    six = freedom.coordinates(fit.T_target_source, reference)
    np.testing.assert_allclose(six[~free], 0.0, atol=1e-13)
    # The slope along each allowed motion is rounding.
    along = freedom.twists(fit.T_target_source, reference).T @ case.cost.gradient(fit.T_target_source)
    assert np.abs(along).max(initial=0.0) <= 1e-11 * np.abs(case.cost.hessian(reference)).max()
    if not words:
        np.testing.assert_allclose(fit.T_target_source, reference, atol=1e-15)
        return

    def value(x: np.ndarray) -> float:
        moved = np.zeros(6)
        moved[free] = x
        return float(np.sum(case.residuals(freedom.moved(reference, moved)) ** 2))

    # Brute force in the free numbers alone, by another method; it stops 1e-8 away, where the cost is 1e-14 above.
    found = minimize(value, np.zeros(free.sum()), method="BFGS", options={"gtol": 1e-6})
    assert fit.cost == pytest.approx(found.fun, rel=1e-9)
    np.testing.assert_allclose(six[free], found.x, atol=1e-4)


@fast
@given(freedoms(), st.integers(0, 200), st.floats(-np.pi, np.pi))
def test_an_allowed_truth_is_found_from_nowhere(words, seed: int, angle_rad: float) -> None:
    # Exact features, moved from the reference by an allowed motion of any size: the search must find it.
    rng = np.random.default_rng(seed)
    freedom, reference = Freedom.only(*words, frame=frames(seed)), frames(seed + 1)
    six = np.where(freedom.mask, rng.uniform(-1, 1, 6), 0.0)
    six[:3] *= angle_rad / max(np.linalg.norm(six[:3]), 1e-9)
    truth = freedom.moved(reference, six)
    p, normals = rng.normal(size=(2, 30, 3))
    q = pose.apply(truth, p) + np.cross(normals, rng.normal(size=(30, 3)))
    fit = PoseCost.planes(p, q, normals).minimise(dof=freedom, reference=reference)
    np.testing.assert_allclose(fit.T_target_source, truth, atol=1e-10)


@pytest.mark.parametrize("words", GROUPS, ids=lambda words: " ".join(words) or "none")
def test_in_a_group_the_reference_may_be_any_allowed_pose(words: tuple[str, ...]) -> None:
    case, freedom, reference = mixed(2, noise=0.1), Freedom.only(*words, frame=frames(7)), frames(8)
    rng = np.random.default_rng(0)
    other = freedom.moved(reference, np.where(freedom.mask, rng.uniform(-1, 1, 6), 0.0))
    a = case.cost.minimise(dof=freedom, reference=reference)
    b = case.cost.minimise(dof=freedom, reference=other)
    assert a.cost == pytest.approx(b.cost, rel=1e-12)
    np.testing.assert_allclose(a.T_target_source, b.T_target_source, atol=1e-10)


def test_all_free_is_not_locked_and_locked_is_not_zeroed() -> None:
    case = mixed(3, 0.4, noise=0.1)
    near = case.truth @ pose.exp([0.1, 0.2, 0.1, 0.2, 0, 0])
    free = case.cost.minimise(near=near)
    np.testing.assert_allclose(
        case.cost.minimise(near=near, dof="all").T_target_source, free.T_target_source, atol=1e-11
    )
    # Solving all six and dropping what is locked is another pose, and a worse one.
    table = Freedom.only("rz", "tx", "ty")
    locked = case.cost.minimise(near=near, dof=table)
    dropped = table.project(free.T_target_source, near)
    assert locked.cost < 0.999 * case.cost.value(dropped)


@pytest.mark.parametrize("words", ["rz tx ty", "rz tx ty tz", "tx ty tz", "rz tz", "all"])
def test_a_far_frame_costs_no_digits(words: str) -> None:
    # The frame's origin is 4e6 from the part, as map coordinates are; its z axis passes by the part where it must.
    near, remote = mixed(5), mixed(5, far=1e6)
    shift = 1e6 * np.array([0.5, 4.4, -0.1])
    reference = near.truth @ pose.exp([0.02, -0.01, 0.05, 0.1, 0.0, 0.1])
    here = near.cost.minimise(near=reference, dof=Freedom.only(words))
    at = shift if words == "rz tz" else [0.0, 0.0, 0.0]
    there = remote.cost.minimise(near=pose.about(reference, shift), dof=Freedom.only(words, frame=at))
    assert pose.angle_between(here.T_target_source, there.T_target_source) < 1e-8
    assert pose.offset_between(pose.about(here.T_target_source, shift), there.T_target_source, at=shift) < 1e-8


def test_what_is_locked_need_not_be_felt() -> None:
    # A plane leaves three motions free; with those locked the other three are solved without a pose to begin at.
    rng = np.random.default_rng(0)
    p = rng.uniform(-1, 1, (30, 3)) * [1, 1, 0]
    cost = PoseCost.planes(p, p + np.array([0.3, 0.2, 0.5]), np.tile([0.0, 0, 1], (30, 1)))
    # Turned over, the plane fits as well: of equal poses the one that turns least is the answer.
    fit = cost.minimise(dof="rx ry tz", reference=np.eye(4))
    np.testing.assert_allclose(fit.T_target_source, pose.from_parts(np.eye(3), [0, 0, 0.5]), atol=1e-12)
    with pytest.raises(DegenerateGeometryError, match=r"translation along \(1.00, 0.00, 0.00\)"):
        cost.minimise(dof="rx tx tz", reference=np.eye(4))
    kept = cost.minimise(near=pose.from_parts(np.eye(3), [4, 0, 0]), dof="rx tx tz")
    assert kept.free == ("translation along (1.00, 0.00, 0.00)",)
    np.testing.assert_allclose(kept.T_target_source[:3, 3], [4, 0, 0.5], atol=1e-12)


def test_a_start_off_the_allowed_poses_is_brought_to_them() -> None:
    case, freedom = mixed(6, 0.3), Freedom.only("rz", "tx")
    reference = case.truth
    near = case.truth @ pose.exp([0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
    fit = case.cost.minimise(near=near, dof=freedom, reference=reference)
    again = case.cost.minimise(near=reference, dof=freedom)
    np.testing.assert_allclose(fit.T_target_source, again.T_target_source, atol=1e-11)
