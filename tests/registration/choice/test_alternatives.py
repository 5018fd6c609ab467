from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import dqreg
from dqreg.registration.choice.alternatives import alternatives_of, on_other_sides
from dqreg.registration.fit.fit import Fit, coarse_to_fine
from dqreg.registration.initial_pose import FOUND
from dqreg.registration.other_poses.same_poses import but_on_the_way
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, random_pose, scan_mesh, worst_vertex_displacement
from dqreg.synth.parts import angle
from dqreg.synth.parts.blocks import cells
from dqreg.synth.parts.patches import weld
from tests.registration.scenes import problem_of

# A plain base of 8 by 5, with a boss off its middle: nothing below the base tells half a turn about its axis.
FILLED = np.zeros((3, 3, 2), dtype=bool)
FILLED[:, :, 0] = FILLED[1, 1, 1] = True
EDGES = [np.array([0.0, 1.0, 3.0, 8.0]), np.array([0.0, 1.0, 2.0, 5.0]), np.array([0.0, 1.2, 2.0])]
PART = dqreg.Mesh(*weld(cells(EDGES, FILLED)))
TARGET = dqreg.prepare_target(PART)
HALF_TURN = pose.about(np.diag([-1.0, -1.0, 1.0, 1.0]), [4.0, 2.5, 0.0])
NOISE = 1e-4 * PART.diagonal


def sparse_scan(rng: np.random.Generator, side: float) -> np.ndarray:
    """Some 600 points of the underside and two sides of the base, or of the upper side, in the part's frame."""
    azimuth = np.deg2rad(90.0 * rng.integers(4) + rng.uniform(20.0, 70.0))
    elevation = np.deg2rad(rng.uniform(30.0, 50.0))
    across = np.cos(elevation)
    view = (across * np.cos(azimuth), across * np.sin(azimuth), side * np.sin(elevation))
    scanner = Scanner([view], pixels=40, stand_off=2.0)
    return scan_mesh(PART.vertices, PART.faces, scanner, Noise(range_sigma=NOISE), rng=rng).points


@pytest.mark.parametrize("seed", range(10))
def test_half_a_turn_that_a_sparse_scan_cannot_tell_is_named(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, T = sparse_scan(rng, side=-1.0), random_pose(rng, 2.0 * PART.diagonal, PART.centre)
    result = TARGET.register(pose.apply(pose.inverse(T), points))
    other = HALF_TURN @ result.T_target_source
    off = [worst_vertex_displacement(a.T_target_source, other, PART.vertices) for a in result.alternatives]
    # Both ends come from the same points.
    assert min(off) < 10.0 * NOISE
    assert "alternative_poses" in result.verdict.codes


@pytest.mark.parametrize("seed", range(4))
def test_a_sparse_scan_that_shows_the_boss_has_one_pose(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, T = sparse_scan(rng, side=1.0), random_pose(rng, 2.0 * PART.diagonal, PART.centre)
    result = TARGET.register(pose.apply(pose.inverse(T), points))
    assert worst_vertex_displacement(result.T_target_source, T, PART.vertices) < 10.0 * NOISE
    assert result.verdict.level == "accepted"
    assert result.alternatives == ()


def fit_at_truth(points: np.ndarray, part: dqreg.Mesh) -> Fit:
    """The fit of a scan in the part's frame."""
    problem = problem_of(points, part, "identity")
    prepared, T = problem.prepare(), problem.to_centred(np.eye(4))
    constraints = problem.constraints(T)
    settings = problem.options.icp_settings(problem.max_distance(prepared), constraints)
    fit = coarse_to_fine(problem, prepared, T, settings, constraints)
    # As from nothing: no initial pose decides.
    return dataclasses.replace(fit, problem=dataclasses.replace(problem, start=None))


def half_turned(fit: Fit, half_turn: np.ndarray) -> np.ndarray:
    """The pose of such a fit after half a turn in the caller's frame, between the centred frames."""
    return fit.problem.to_centred(half_turn) @ pose.inverse(fit.problem.to_centred(np.eye(4))) @ fit.T_target_source


@pytest.fixture(scope="module")
def below() -> Fit:
    """The fit of a scan of the underside."""
    return fit_at_truth(sparse_scan(np.random.default_rng(0), side=-1.0), PART)


def rough_and_exact(fit: Fit) -> np.ndarray:
    """Its half turn as a search of few points may leave it, a degree off, and as it is, between the centred frames."""
    turned = half_turned(fit, HALF_TURN)
    off = pose.about(pose.exp(np.r_[np.deg2rad([0.6, -0.6, 0.6]), np.zeros(3)]), np.zeros(3))
    return np.stack([off @ turned, turned])


def test_of_poses_that_are_one_the_likeliest_is_named(below: Fit) -> None:
    both = rough_and_exact(below)
    assert alternatives_of(below, below, both[:1]) == ()
    for others in (both, both[::-1]):
        (named,) = alternatives_of(below, below, others)
        assert abs(named.gain) <= max(3.0 * named.gain_sigma, 0.01)


def test_a_rough_pose_is_followed_to_where_the_loop_ends(below: Fit) -> None:
    rough, exact = rough_and_exact(below)
    ends = but_on_the_way(below, rough[None], FOUND * PART.diagonal)
    off = [worst_vertex_displacement(T, exact, PART.vertices) for T in ends]
    assert min(off) < 10.0 * NOISE
    # One from which it arrives at the answer is none.
    near = pose.about(pose.exp(np.r_[0.01, 0.0, 0.0, np.zeros(3)]), np.zeros(3)) @ below.T_target_source
    assert len(but_on_the_way(below, near[None], FOUND * PART.diagonal)) == 0


def test_a_rival_that_lies_on_the_wrong_side_of_a_sheet_is_laid_on_the_right_one() -> None:
    # The long leg of an angle from below: half a turn about the line through its holes lays it onto its upper side,
    # which a search that knows no sides may take for its lower one, a thickness off.
    part = dqreg.Mesh(*angle())
    noise, scanner = 3e-4 * part.diagonal, Scanner([(0.4, -0.6, -1.0)], pixels=100, stand_off=2.0)
    points = scan_mesh(
        part.vertices, part.faces, scanner, Noise(range_sigma=noise), rng=np.random.default_rng(0)
    ).points
    fit = fit_at_truth(points[(points[:, 0] > 12.0) & (points[:, 0] < 84.0) & (points[:, 2] < 3.0)], part)
    half_turn, thickness = pose.about(np.diag([-1.0, 1.0, -1.0, 1.0]), [48.0, 35.0, 1.0]), 2.0
    other = half_turned(fit, half_turn)
    behind = pose.from_parts(np.eye(3), [0.0, 0.0, -thickness]) @ other
    ends = on_other_sides(fit, behind[None], FOUND * part.diagonal)
    assert min(worst_vertex_displacement(T, other, part.vertices) for T in ends) < 10.0 * noise
    # Its own other side is no place of another.
    own = pose.from_parts(np.eye(3), [0.0, 0.0, thickness]) @ fit.T_target_source
    assert len(on_other_sides(fit, own[None], FOUND * part.diagonal)) == 0
