from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.errors import InputError
from dqreg.rigid import pose, twist
from dqreg.synth import disturbance, worst_vertex_displacement
from tests.icp.scenes import bracket_mesh, bracket_points

PART = bracket_mesh()
SIZE = PART.diagonal
POINTS = bracket_points(100, seed=0)
# The scan is made in the part's frame: the truth is the identity.
TURN_DEG, SHIFT = 6.0, np.array([0.02, -0.01, 0.0]) * SIZE


def planar_start() -> np.ndarray:
    """A start that differs from the truth by what "rz tx ty" allows."""
    a = np.deg2rad(TURN_DEG)
    R = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    return pose.from_parts(R, SHIFT)


def test_a_part_on_a_table_turns_and_slides_and_nothing_else() -> None:
    result = dqreg.register(POINTS, PART, planar_start(), dof="rz tx ty")
    T = result.T_target_source
    # Locked motions are kept to the last bits: no tilt, no lift.
    np.testing.assert_allclose(T[2], [0.0, 0.0, 1.0, 0.0], atol=1e-12 * SIZE)
    np.testing.assert_allclose(T[:2, 2], 0.0, atol=1e-12)
    # The free ones come home to the noise of 8,000 points.
    assert worst_vertex_displacement(T, np.eye(4), PART.vertices) <= 1e-4 * SIZE
    assert result.settings["dof"] == "rz tx ty"
    assert result.verdict.level == "accepted", result.verdict


def test_what_is_locked_has_no_uncertainty_and_is_no_direction() -> None:
    result = dqreg.register(POINTS, PART, planar_start(), dof="rz tx ty")
    assert len(result.observability) == 3
    deviations = np.sqrt(np.diag(result.covariance))
    np.testing.assert_allclose(deviations[[0, 1, 5]], 0.0, atol=1e-12 * SIZE)
    assert (deviations[[2, 3, 4]] > 0.0).all()
    free = np.sqrt(np.diag(dqreg.register(POINTS, PART, planar_start()).covariance))
    # Knowing three motions can only help the other three.
    assert (deviations[[2, 3, 4]] <= 1.05 * free[[2, 3, 4]]).all()


@pytest.mark.parametrize("offset", [np.zeros(3), np.array([5e5, 4.4e6, 100.0])])
def test_locks_hold_in_the_callers_frame_wherever_that_is(offset: np.ndarray) -> None:
    far = dqreg.Mesh(PART.vertices + offset, PART.faces)
    frame = pose.from_parts(np.eye(3), offset)
    start = frame @ planar_start() @ pose.inverse(frame)
    freedom = dqreg.Freedom.only("rz", "tx", "ty", frame=frame)
    T = dqreg.register(POINTS + offset, far, start, dof=freedom).T_target_source
    home = pose.inverse(frame) @ T @ frame
    np.testing.assert_allclose(home[2], [0.0, 0.0, 1.0, 0.0], atol=1e-8)
    assert worst_vertex_displacement(home, np.eye(4), PART.vertices) <= 1e-4 * SIZE


def test_a_strong_prior_pins_and_a_weak_one_does_not() -> None:
    rng = np.random.default_rng(0)
    T_prior = disturbance(rng, np.deg2rad(2.0), 0.01 * SIZE, PART.centre)
    scales = np.r_[[1.0 / SIZE] * 3, [1.0] * 3] * SIZE

    def off(share: float, other: np.ndarray) -> float:
        covariance = np.diag((share * scales) ** 2)
        T = dqreg.register(POINTS, PART, prior=(T_prior, covariance)).T_target_source
        return worst_vertex_displacement(T, other, PART.vertices) / SIZE

    assert off(1e-9, T_prior) <= 1e-6
    assert off(1.0, np.eye(4)) <= 1e-4


def test_six_variances_are_a_covariance() -> None:
    variances = [1e-4, 1e-4, 1e-4, 0.1, 0.2, 0.3]
    one, other = (
        dqreg.register(POINTS, PART, prior=(np.eye(4), given)).T_target_source
        for given in (variances, np.diag(variances))
    )
    np.testing.assert_array_equal(one, other)


def test_a_prior_adds_its_information() -> None:
    T = np.eye(4)
    free = dqreg.register(POINTS, PART, T)
    # As uncertain as the answer itself: the covariance halves.
    both = dqreg.register(POINTS, PART, T, prior=(free.T_target_source, free.covariance))
    np.testing.assert_allclose(
        np.sqrt(np.diag(both.covariance)) / np.sqrt(np.diag(free.covariance)), np.sqrt(0.5), rtol=0.15
    )


def test_a_prior_decides_what_the_scan_cannot() -> None:
    # A plane alone: it slides and spins. The prior holds it, and the verdict has nothing free to name.
    flat = np.abs(POINTS[:, 2] - POINTS[:, 2].min()) < 1e-3 * SIZE
    points = POINTS[flat] if flat.sum() > 200 else POINTS[POINTS[:, 2] < np.quantile(POINTS[:, 2], 0.05)]
    covariance = np.diag(np.r_[[1e-3] * 3, [1e-3 * SIZE] * 3] ** 2)
    alone = dqreg.register(points, PART, np.eye(4), max_distance=0.02 * SIZE)
    held = dqreg.register(points, PART, np.eye(4), max_distance=0.02 * SIZE, prior=(np.eye(4), covariance))
    assert np.isfinite(held.covariance).all()
    assert sum(d.is_free for d in held.observability) <= sum(d.is_free for d in alone.observability)
    step = twist.log(held.T_target_source)
    assert np.linalg.norm(step[3:]) <= 5e-3 * SIZE


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"dof": "rz"}, "there is none: give start, or a prior"),
        ({"dof": "rz yaw", "start": "identity"}, "yaw"),
        ({"prior": np.eye(4)}, r"prior must be \(pose, covariance\)|prior"),
        ({"prior": (np.eye(4), np.eye(3))}, "6"),
        ({"prior": (2.0 * np.eye(4), np.eye(6))}, "prior"),
        ({"time_limit": 0.0, "start": "identity"}, "time_limit"),
        ({"units": "mm", "start": "identity"}, "unknown units 'mm'; known are check, ignore"),
    ],
)
def test_what_cannot_be_known_is_refused_in_words(options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        dqreg.register(POINTS, PART, **options)


def test_a_time_limit_that_is_over_at_once_says_so() -> None:
    result = dqreg.register(POINTS, PART, planar_start(), time_limit=1e-6)
    assert result.status == "time limit"
    assert result.verdict.level != "accepted"
    assert any("time limit" in reason for reason in result.verdict.reasons)


def test_a_search_cut_short_says_so() -> None:
    result = dqreg.register(POINTS, PART, time_limit=1e-6)
    assert result.verdict.level != "accepted"
    assert {"search_time_limit", "not_converged"} & set(result.verdict.codes)


TILT_DEG = 3.0


def tilted(points: np.ndarray) -> np.ndarray:
    """Points tilted about x, which "rz tx ty" locks."""
    return pose.apply(pose.about(pose.exp(np.r_[np.deg2rad(TILT_DEG), np.zeros(5)]), PART.centre), points)


@pytest.mark.parametrize("held", [{"dof": "rz tx ty tz"}, {"prior": (np.eye(4), 1e-12 * np.eye(6))}])
def test_a_motion_that_is_forbidden_and_asked_for_is_named_with_its_size(held: dict[str, object]) -> None:
    verdict = dqreg.register(tilted(POINTS), PART, "identity", **held).verdict
    assert verdict.level == "suspect"
    assert verdict.codes[0] == "forbidden_motion"
    assert "a rotation by 3 degrees" in str(verdict.reasons[0])
    # The part is the right one, and so is its hand.
    assert "mirrored" not in verdict.codes


def test_a_mirrored_scan_is_one_where_motions_are_locked_too() -> None:
    for points in (POINTS, tilted(POINTS)):
        mirrored = points * [1.0, -1.0, 1.0] + [0.0, 2.0 * PART.centre[1], 0.0]
        assert "mirrored" in dqreg.register(mirrored, PART, "identity", dof="rz tx ty tz").verdict.codes


def test_of_a_scan_that_fits_no_forbidden_motion_is_asked() -> None:
    found = dqreg.register(tilted(POINTS), PART, "identity", dof="rx rz tx ty tz")
    assert found.verdict.level == "accepted"
    (check,) = [check for check in found.verdict.checks if check.code == "forbidden_motion"]
    assert check.passed is None


@pytest.mark.parametrize(("sigmas", "remarks"), [(2.0, ()), (50.0, ("contradicted_prior",))])
def test_a_prior_that_the_scan_excludes_is_said(sigmas: float, remarks: tuple[str, ...]) -> None:
    sigma = 1e-3 * SIZE
    off = pose.from_parts(np.eye(3), [sigmas * sigma, 0.0, 0.0])
    result = dqreg.register(POINTS, PART, "identity", prior=(off, [1e-3] * 3 + [sigma**2] * 3))
    assert result.verdict.codes == ("accepted", *remarks)
