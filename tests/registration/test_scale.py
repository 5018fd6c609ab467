from __future__ import annotations

import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.compare.trust.scans import VIEW_PIXELS, oblique, rows_of, thinned
from dqreg.compare.trust.shapes import any_part
from dqreg.errors import InputError
from dqreg.geometry import Mesh, PointCloud, prepare_scan, sample_mesh
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.registration.scale import _last_step
from dqreg.registration.scale_search import scale_starts
from dqreg.registration.target import prepare_target
from dqreg.report.summary import summary_rows
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, disturbance, scan_mesh
from dqreg.synth.parts import box
from tests.icp.scenes import bracket_mesh

PART = bracket_mesh()
SIZE = PART.diagonal
TARGET = prepare_target(PART)
NOISE = 3e-4 * SIZE


def scan_of(scale: float, T: FloatArray, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Points on the part, two views, and the same in numbers that ask for the scale and the pose."""
    scanner = Scanner([(1, 1, 1), (-1, 0.3, -0.8)], pixels=110)
    points = scan_mesh(
        PART.vertices, PART.faces, scanner, Noise(range_sigma=NOISE), rng=np.random.default_rng(seed)
    ).points
    return points, pose.apply(pose.inverse(T), points) / scale


def assert_solved(result: Registration, points: FloatArray, source: FloatArray, scale: float) -> None:
    # The truth is by construction. A standard deviation is right to a few of itself; about 9,000 points with noise of
    # 3e-4 of the size leave some 1e-5 of it open.
    assert result.verdict.level == "accepted"
    assert abs(result.scale - scale) <= 4.5 * result.scale_sigma
    assert result.scale_sigma < 1e-4 * scale
    assert np.abs(result.apply(source) - points).max() < 1.5e-4 * SIZE
    R = result.T_target_source[:3, :3]
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("scale", [0.91, 25.4])
def test_a_scan_in_other_numbers_is_solved_from_a_rough_start(scale: float) -> None:
    T = disturbance(np.random.default_rng(1), np.deg2rad(6.0), 0.02 * SIZE, PART.centre)
    points, source = scan_of(scale, T)
    result = register(source, TARGET, "identity", scale="solve", effort="fast")
    assert_solved(result, points, source, scale)
    assert (result.settings["start"], result.settings["units"]) == ("identity", "check")


def test_a_wrong_scale_that_explains_most_of_a_view_does_not_end_the_search() -> None:
    # One noisy view of a part from a generator: 96 % of it fit at 0.58 of its scale, which no unit is near.
    rng = np.random.default_rng([zlib.crc32(b"solved_scale"), 23201])
    part = any_part(rng)
    noise = np.exp(rng.uniform(np.log(1e-4), np.log(3e-3))) * part.diagonal
    scanner = Scanner(rows_of(oblique(rng)), pixels=VIEW_PIXELS)
    view = scan_mesh(part.vertices, part.faces, scanner, Noise(range_sigma=noise), rng=rng).points
    result = register(thinned(view, rng, 800, 4_000) / 0.6, part, scale="solve")
    assert result.verdict.level == "accepted"
    assert abs(result.scale - 0.6) <= 4.5 * result.scale_sigma


def test_a_scan_in_other_numbers_is_solved_from_nothing() -> None:
    T = pose.random(np.random.default_rng(2), reach=3.0 * SIZE)
    points, source = scan_of(0.96, T)
    result = register(source, TARGET, scale="solve", effort="fast")
    assert_solved(result, points, source, 0.96)
    assert result.settings["start"] == "search"


def test_the_pose_s_covariance_knows_that_the_scale_is_not() -> None:
    # The source's own origin lies 200 sizes off: there a wrong scale is a wrong shift.
    T = pose.from_parts(np.eye(3), [200.0 * SIZE, 0.0, 0.0])
    _, source = scan_of(1.05, T)
    # A start that somebody had who took the source as it is.
    start = pose.from_parts(np.eye(3), [200.0 * SIZE / 1.05, 0.0, 0.0])
    result = register(source, TARGET, start, scale="solve", effort="fast")
    assert result.verdict.level == "accepted"
    shift = np.sqrt(result.covariance[3, 3])
    assert shift == pytest.approx(200.0 * SIZE * result.scale_sigma / result.scale, rel=0.1)
    assert abs(result.T_target_source[0, 3] - 200.0 * SIZE) <= 4.5 * shift


def test_a_plane_has_any_scale_and_the_verdict_says_so() -> None:
    block = Mesh(*box((3.0, 2.0, 1.0)))
    top = sample_mesh(block, 20_000, np.random.default_rng(3)).points
    top = top[top[:, 2] > 0.499] + np.random.default_rng(4).normal(scale=1e-3, size=(1, 3))
    result = register(top, block, "identity", scale="solve", effort="fast")
    assert result.verdict.level == "suspect"
    assert result.verdict.codes[0] == "scale_unobservable"
    assert np.isnan(result.scale_sigma)
    assert "not fixed by the data" in dict(summary_rows(result))["scale"]


def test_a_factor_is_taken_as_it_is(tmp_path: Path) -> None:
    points, source = scan_of(2.0, np.eye(4))
    result = register(source, TARGET, "identity", scale=2.0, effort="fast")
    plain = register(points, TARGET, "identity", effort="fast")
    np.testing.assert_allclose(result.T_target_source, plain.T_target_source, atol=1e-9 * SIZE)
    assert (result.scale, result.scale_sigma, plain.scale) == (2.0, 0.0, 1.0)
    result.save(tmp_path / "result.json")
    back = Registration.load(tmp_path / "result.json")
    assert (back.scale, back.scale_sigma) == (2.0, 0.0)
    np.testing.assert_array_equal(back.apply(source), result.apply(source))
    attached = back.attached(source, PART)
    np.testing.assert_array_equal(attached.deviations().values, result.deviations().values)
    assert result.to_dict()["scale"] == 2.0
    assert "scale" not in dict(summary_rows(plain))


def test_nothing_is_scaled_unasked() -> None:
    _, source = scan_of(1.03, np.eye(4))
    result = register(source, TARGET, "identity", effort="fast")
    assert result.scale == 1.0
    assert result.verdict.level != "accepted"


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf, "guess", True, [1.0], None])
def test_what_is_no_scale_is_refused(scale: object) -> None:
    with pytest.raises(InputError, match="scale must be a number above 0"):
        register(np.eye(3), TARGET, "identity", scale=scale)


@pytest.mark.parametrize("more", [{"dof": "tx"}, {"prior": (np.eye(4), np.eye(6))}, {"viewpoint": [0, 0, 1]}])
def test_the_scale_is_not_solved_beside_what_it_cannot_be_solved_with(more: dict[str, object]) -> None:
    with pytest.raises(InputError, match="cannot be combined"):
        register(np.eye(3), TARGET, "identity", scale="solve", **more)


def test_scales_that_are_tried_are_those_that_sizes_and_units_allow() -> None:
    assert scale_starts(1.05, searched=True)[0][0] == 1.0
    assert 25.4 in scale_starts(26.0, searched=False)[0]
    assert 1000.0 in scale_starts(1300.0, searched=False)[0]
    assert pytest.approx(1.0 / 25.4) in scale_starts(0.04, searched=False)[0]
    assert 5000.0 in scale_starts(5000.0, searched=False)[0]


def test_the_last_step_leaves_points_near_creases_out() -> None:
    # The law: at the true scale and pose the step is zero in the mean. Noise carries points over an edge onto the face
    # behind it, to one side: with these the step is smaller by a standard deviation.
    part = Mesh(*box())
    index, noise = prepare_target(part).indexed, 2e-3 * part.diagonal
    settings = {"width": noise, "max_distance": 0.1 * part.diagonal, "effort": "fast"}
    told = SimpleNamespace(settings=settings, inlier_fraction=0.99, T_target_source=np.eye(4))
    told.inputs = SimpleNamespace(to_centred=lambda T: T)
    steps = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        points = sample_mesh(part, 20000, rng).points - index.origin
        scan = prepare_scan(PointCloud(points + noise * rng.normal(size=points.shape)))
        task: Any = SimpleNamespace(search=SimpleNamespace(scan=scan, target=index))
        result: Any = told
        step = _last_step(task, result, 1.0)
        steps.append(np.log(step.factor) / step.sigma)
    # Standard error of the mean 0.2.
    assert abs(np.mean(steps)) < 0.5
