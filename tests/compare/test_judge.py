from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.compare.judge import GroundTruth, judge, kind_of, worst_along
from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.rigid import pose
from dqreg.synth import worst_vertex_displacement
from dqreg.synth.parts import box, bracket

PART = Mesh(*bracket())
MIRROR = np.diag([1.0, 1.0, -1.0, 1.0])
seeds = st.integers(0, 2**32 - 1)


def known(truth: np.ndarray, **more) -> GroundTruth:
    return GroundTruth(PART.vertices, PART.diagonal, truth[None], **more)


def some_pose(rng: np.random.Generator, reach: float = 100.0) -> np.ndarray:
    return pose.random(rng, reach=reach)


@given(seeds)
@settings(deadline=None, max_examples=30)
def test_truth_scores_zero(seed):
    truth = some_pose(np.random.default_rng(seed))
    score = judge(truth, known(truth))
    assert (score.kind, score.success) == ("rigid", True)
    assert (score.worst, score.rms, score.offset) == (0.0, 0.0, 0.0)
    assert score.angle_rad < 1e-12


@given(seeds)
@settings(deadline=None, max_examples=30)
def test_score_does_not_see_the_frames(seed):
    # Law: with both frames moved, T' = A T B and the probes by A, no figure changes. 1e-9 S for numbers of 100 S.
    rng = np.random.default_rng(seed)
    truth, T, A, B = (some_pose(rng) for _ in range(4))
    here = judge(T, known(truth))
    there = judge(A @ T @ B, GroundTruth(pose.apply(A, PART.vertices), PART.diagonal, (A @ truth @ B)[None]))
    for name in ("worst", "rms"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-9 * PART.diagonal)
    assert there.angle_rad == pytest.approx(here.angle_rad, abs=1e-7)
    assert there.success == here.success


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_displacements_are_those_of_an_independent_formula(seed):
    rng = np.random.default_rng(seed)
    truth, T = some_pose(rng), some_pose(rng)
    moved = pose.apply(pose.inverse(truth), PART.vertices)
    expected = np.linalg.norm(pose.apply(T, moved) - PART.vertices, axis=1)
    score = judge(T, known(truth))
    assert score.worst == pytest.approx(expected.max(), abs=1e-10)
    assert score.rms == pytest.approx(np.sqrt(np.mean(expected**2)), abs=1e-10)
    assert score.worst == pytest.approx(worst_vertex_displacement(T, truth, PART.vertices), abs=1e-9)


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_wrong_identity_and_mirrored_poses_fail(seed):
    rng = np.random.default_rng(seed)
    truth = some_pose(rng)
    step = pose.from_parts(np.eye(3), [0.02 * PART.diagonal, 0.0, 0.0])
    turned = pose.about(pose.exp(np.array([0.0, 0.0, 0.05, 0.0, 0.0, 0.0])), PART.centre)
    for T in (step @ truth, turned @ truth, np.eye(4)):
        score = judge(T, known(truth))
        assert (score.kind, score.success) == ("rigid", False)
        assert score.worst > 0.01 * PART.diagonal
    for T in (truth @ MIRROR, MIRROR @ truth):
        score = judge(T, known(truth))
        assert (score.kind, score.success) == ("mirrored", False)
        assert np.isnan(score.angle_rad)


def test_a_mirror_in_the_plane_of_a_flat_part_fails_though_no_vertex_moves():
    flat = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [2, 1, 0]])
    score = judge(MIRROR, GroundTruth(flat, 2.0, np.eye(4)[None]))
    assert (score.worst, score.kind, score.success) == (0.0, "mirrored", False)


def test_a_scale_is_not_rigid_and_counts_as_what_it_does():
    scaled = np.diag([1.001, 1.001, 1.001, 1.0])
    score = judge(scaled, known(np.eye(4)))
    assert (score.kind, score.success) == ("not rigid", False)
    assert score.worst == pytest.approx(0.001 * np.linalg.norm(PART.vertices, axis=1).max())
    assert kind_of(np.vstack([np.eye(4)[:3], [0, 0, 1e-3, 1]])) == "not rigid"


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nothing_found_is_nan_and_a_failure(bad):
    T = np.eye(4)
    T[1, 2] = bad
    score = judge(T, known(np.eye(4), held_out=np.ones((3, 3)), surface=MeshSurface(PART), gate=1.0))
    assert (score.kind, score.success, score.overlap) == ("nothing", False, 0.0)
    assert np.isnan([score.angle_rad, score.offset, score.worst, score.rms, score.surface_rms]).all()


def test_what_is_no_matrix_is_refused():
    with pytest.raises(InputError, match="4x4"):
        judge(np.eye(3), known(np.eye(4)))


def test_any_of_the_symmetric_truths_will_do():
    cube = Mesh(*box())
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    truth = some_pose(np.random.default_rng(5))
    ground_truth = GroundTruth(cube.vertices, cube.diagonal, np.stack([truth, half_turn @ truth]))
    assert judge(half_turn @ truth, ground_truth).success
    assert judge(half_turn @ truth, ground_truth).worst < 1e-12
    quarter = pose.exp(np.array([0.0, 0.0, np.pi / 2, 0.0, 0.0, 0.0]))
    assert not judge(quarter @ truth, ground_truth).success


@given(seeds, st.floats(-3.1, 3.1))
@settings(deadline=None, max_examples=30)
def test_any_turn_about_an_axis_of_revolution_is_true(seed, angle):
    rng = np.random.default_rng(seed)
    truth, direction, point = some_pose(rng), rng.normal(size=3), rng.normal(size=3)
    axis = np.stack([point, 3.0 * direction])
    turn = pose.about(pose.exp(np.r_[angle * direction / np.linalg.norm(direction), 0, 0, 0]), point)
    ground_truth = known(truth, axis=axis)
    assert judge(turn @ truth, ground_truth).worst < 1e-9 * PART.diagonal
    # A shift along the axis is not forgiven: it moves each vertex by its length.
    along = pose.from_parts(np.eye(3), 5.0 * direction / np.linalg.norm(direction))
    assert judge(along @ turn @ truth, ground_truth).worst == pytest.approx(5.0, rel=1e-9)


def test_held_out_points_measure_the_surface():
    # Points of the part lifted by 0.1 along the outward normals: at truth 0.1 off, but for those beyond the gate.
    truth = some_pose(np.random.default_rng(1))
    corners = PART.corners.mean(axis=1)
    lifted = corners + 0.1 * PART.face_normals
    lifted[::4] += 30.0 * PART.face_normals[::4] + 200.0
    ground_truth = known(truth, held_out=pose.apply(pose.inverse(truth), lifted), surface=MeshSurface(PART), gate=0.5)
    score = judge(truth, ground_truth)
    assert score.surface_rms == pytest.approx(0.1, rel=1e-6)
    assert score.overlap == pytest.approx(0.75, abs=0.01)


def test_without_a_truth_only_the_surface_is_judged():
    ground_truth = GroundTruth(
        PART.vertices, PART.diagonal, np.zeros((0, 4, 4)), None, PART.vertices, MeshSurface(PART), 0.1
    )
    score = judge(np.eye(4), ground_truth)
    assert score.success is None
    assert np.isnan(score.worst)
    assert score.overlap == 1.0
    assert judge(np.full((4, 4), np.nan), ground_truth).success is None


def test_curve_is_the_worst_displacement_of_each_pose():
    steps = [pose.from_parts(np.eye(3), [shift, 0.0, 0.0]) for shift in (3.0, 2.0, 0.0)]
    np.testing.assert_allclose(worst_along(steps, known(np.eye(4))), [3.0, 2.0, 0.0], atol=1e-12)


def test_the_judge_imports_no_engine():
    # Read, not run: importing any part of a package runs the package's own index first.
    seen: set[str] = set()
    todo = ["dqreg.compare.judge"]
    while todo:
        name = todo.pop()
        if name in seen:
            continue
        seen.add(name)
        todo.extend(imports_of(name))
    assert "dqreg._arrays" in seen
    strangers = (
        "dqreg.compare.engines",
        "dqreg.registration",
        "dqreg.icp",
        "dqreg.search",
        "dqreg.solvers",
        "dqreg.compare.run",
    )
    assert [name for name in seen if name.startswith(strangers)] == []


def imports_of(name: str) -> set[str]:
    spec = importlib.util.find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    found: set[str] = set()
    for node in ast.walk(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("dqreg."):
            found.add(node.module)
            found |= {f"{node.module}.{alias.name}" for alias in node.names if is_module(f"{node.module}.{alias.name}")}
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name.startswith("dqreg.")}
    return found


def is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False
