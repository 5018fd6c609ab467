"""Motions that few points constrain, on a bar: its ends decide where it is along its length."""

from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.compare.trust.kinds import KINDS
from dqreg.compare.trust.task import TrustTask
from dqreg.compare.trust.trial import is_right
from dqreg.geometry import sample_mesh
from dqreg.registration.assessment.assess import uncertainty_of
from dqreg.registration.fit.fit import Fit, coarse_to_fine
from dqreg.registration.other_poses import slides
from dqreg.registration.other_poses.slides import slide_of, without_slide
from dqreg.rigid import pose, twist
from dqreg.synth import worst_vertex_displacement
from dqreg.synth.parts import box
from dqreg.synth.parts.blocks import cells
from dqreg.synth.parts.patches import weld
from dqreg.trust.limits import CONSTRAINT_LOG_LIKELIHOOD, fewest_carriers
from tests.registration.scenes import problem_of

LENGTH, NOISE = 200.0, 0.05
BAR = dqreg.Mesh(*box((LENGTH, 30.0, 20.0)))
# A plate of 150 by 90 by 4 with a window off its middle.
SIDES, HOLE = np.array([150.0, 90.0]), np.array([[60.0, 20.0], [110.0, 50.0]])
_filled = np.ones((3, 3, 1), dtype=bool)
_filled[1, 1, 0] = False
_grid = [np.array([0.0, HOLE[0, k], HOLE[1, k], SIDES[k]]) for k in range(2)]
PLATE = dqreg.Mesh(*weld(cells([*_grid, np.array([0.0, 4.0])], _filled)))
OFF = pose.from_parts(np.eye(3), [0.02 * BAR.diagonal, 0.0, 0.0])


def fit_of(points: np.ndarray, start: np.ndarray, part: dqreg.Mesh = BAR) -> Fit:
    """The loop's fit of a scan in the part's frame: the truth is the identity."""
    rng = np.random.default_rng(1)
    problem = problem_of(points + NOISE * rng.normal(size=points.shape), part, np.eye(4))
    prepared, constraints = problem.prepare(), problem.constraints(np.eye(4))
    settings = problem.options.icp_settings(problem.reach(prepared), constraints)
    return coarse_to_fine(problem, prepared, problem.to_centred(start), settings, constraints)


def sides(on_ends: int) -> np.ndarray:
    """Points all over the long faces, and so many on the ends."""
    points = sample_mesh(BAR, 4_000, np.random.default_rng(0)).points
    is_end = np.abs(np.abs(points[:, 0] - BAR.centre[0]) - 0.5 * LENGTH) < 1e-9
    return np.concatenate([points[~is_end], points[is_end][:on_ends]])


def almost_to_the_rims() -> np.ndarray:
    """Points all over the long faces but for their last half millimetre."""
    points = sides(0)
    return points[np.abs(points[:, 0] - BAR.centre[0]) < 0.5 * LENGTH - 0.5]


def one_side(rim: float) -> np.ndarray:
    """Points on the upper side of a plate with a window, so far from its outline and from the window's."""
    points = sample_mesh(PLATE, 12_000, np.random.default_rng(0)).points
    points = points[points[:, 2] > PLATE.bounds[1][2] - 1e-9]
    inner = ((points[:, :2] > rim) & (points[:, :2] < SIDES - rim)).all(axis=1)
    return points[inner & ((points[:, :2] < HOLE[0] - rim) | (points[:, :2] > HOLE[1] + rim)).any(axis=1)]


@pytest.mark.parametrize("on_ends", [6, 12])
def test_points_beyond_the_rim_hold_the_bar_where_few_points_lie_on_its_ends(on_ends: int) -> None:
    fit = fit_of(sides(on_ends), np.eye(4))
    assert (fit.information.carriers < fewest_carriers(float(fit.run.weights.sum()))).any()
    assert slide_of(fit).loss > 5.0 * CONSTRAINT_LOG_LIKELIHOOD


def test_few_strays_hold_nothing() -> None:
    # The middle of the bar, and three points beside it where an end would be: each says little, and no rim is there.
    points = sides(0)
    middle = points[np.abs(points[:, 0] - BAR.centre[0]) < 0.3 * LENGTH]
    ends = np.array([BAR.centre + np.array([0.5 * LENGTH, 5.0 * k, 2.0 * k]) for k in (-1, 0, 1)])
    fit = fit_of(np.concatenate([middle, ends]), np.eye(4))
    assert fit.information.free.sum() == 1
    assert not slide_of(fit).loss >= CONSTRAINT_LOG_LIKELIHOOD


def test_rims_alone_hold_the_bar_where_no_point_lies_on_its_ends() -> None:
    # The scan is made in the part's frame. Points of the long faces nearly reach both rims; no normal tells the length.
    fit = fit_of(almost_to_the_rims(), np.eye(4))
    assert fit.information.free.sum() == 1
    assert slide_of(fit).loss >= CONSTRAINT_LOG_LIKELIHOOD
    along, *_ = uncertainty_of(fit).directions
    assert not along.is_free
    off = abs(fit.problem.to_caller(fit.T_target_source)[0, 3])
    # The figure is above what is off.
    assert off <= along.sigma <= 0.01 * BAR.diagonal
    assert np.isfinite(uncertainty_of(fit).covariance).all()


def test_the_rims_of_an_open_target_hold_nothing() -> None:
    # The same bar without its ends: there the model ends, not the part.
    open_bar = dqreg.Mesh(BAR.vertices, BAR.faces[np.ptp(BAR.vertices[BAR.faces][..., 0], axis=1) > 0.0])
    fit = fit_of(almost_to_the_rims(), np.eye(4), open_bar)
    assert np.isnan(slide_of(fit).by_rims)
    assert uncertainty_of(fit).directions[0].is_free


def test_rims_and_windows_hold_a_plate_of_which_one_side_is_seen() -> None:
    # The scan is made in the part's frame. Of one plane three motions are free; its outline and a window hold them.
    fit = fit_of(one_side(rim=0.2), np.eye(4), PLATE)
    assert fit.information.free.sum() == 3
    found = uncertainty_of(fit).directions
    assert not any(motion.is_free for motion in found)
    off = worst_vertex_displacement(fit.problem.to_caller(fit.T_target_source), np.eye(4), PLATE.vertices)
    assert off <= max(motion.sigma for motion in found) <= 0.02 * PLATE.diagonal
    # The middle of that side may lie anywhere on it.
    assert np.isnan(slide_of(fit_of(one_side(rim=15.0), np.eye(4), PLATE)).by_rims)


def test_a_sparse_scan_of_a_plate_that_slid_and_turned_at_once_comes_back() -> None:
    points = np.random.default_rng(0).permutation(one_side(rim=0.2))[:700]
    fit = fit_of(points, np.eye(4), PLATE)
    T = twist.exp(np.array([0.0, 0.0, np.deg2rad(-2.0), -5.0, 2.0, 0.0]))
    better, _ = without_slide(fit.at(T @ fit.T_target_source))
    off = worst_vertex_displacement(better.problem.to_caller(better.T_target_source), np.eye(4), PLATE.vertices)
    # Less than the least displacement that the rims exclude; motions one at a time led to 2.1.
    assert off <= 0.01 * PLATE.diagonal


def test_a_pose_on_the_slope_is_gone_on_from() -> None:
    fit = fit_of(sides(12), np.eye(4)).at(OFF)
    assert worst_vertex_displacement(OFF, np.eye(4), BAR.vertices) > 0.019 * BAR.diagonal
    better, _ = without_slide(fit)
    off = worst_vertex_displacement(better.problem.to_caller(better.T_target_source), np.eye(4), BAR.vertices)
    # Twelve points fix the end to the noise over their root; six times that.
    assert off <= 6.0 * NOISE / np.sqrt(12.0)


def test_nothing_is_asked_where_enough_points_constrain_every_motion() -> None:
    assert np.isnan(slide_of(fit_of(sides(400), np.eye(4))).loss)


@pytest.mark.parametrize("seed", [8131, 8202, 8245])
def test_a_riser_on_its_neighbours_place_is_no_strain(seed: int) -> None:
    """One view of a stepped part, truth from its generator: the loop ends 1.2 to 1.9 % of the size off.

    Three faces in four fit there, and the others look like a strain along the same axis, or across it. The noise of the
    view is 3e-4.
    """
    task = KINDS["one-view"].task(seed)
    assert isinstance(task, TrustTask)
    found = dqreg.register(task.source, task.target, task.start, **task.options)
    assert found.verdict.level == "accepted"
    assert is_right(found.T_target_source, task)[1] <= 3e-4


@pytest.mark.parametrize("seed", [8619, 23204])
def test_the_table_that_a_part_covers_as_it_slides_is_none_of_the_part(seed: int) -> None:
    """A bracket on a table, truth from its generator: its rims hold it along its legs, few points of their ends do.

    Points of the table gain where its lower side would come to lie on them.
    """
    task = KINDS["on-a-table"].task(seed)
    assert isinstance(task, TrustTask)
    found = dqreg.register(task.source, task.target, task.start, **task.options)
    assert is_right(found.T_target_source, task)[0]
    assert found.verdict.level == "accepted", found.verdict.reasons


def test_few_points_leave_out_no_pose_that_all_of_them_would_name(monkeypatch: pytest.MonkeyPatch) -> None:
    # Oracle: all points at all poses.
    for points in (sides(6), sides(400), almost_to_the_rims()):
        for start in (np.eye(4), OFF):
            found = slide_of(fit_of(points, start))
            monkeypatch.setattr(slides, "SCREENING_POINTS", len(points))
            every = slide_of(fit_of(points, start))
            monkeypatch.undo()
            assert (found.loss >= CONSTRAINT_LOG_LIKELIHOOD) == (every.loss >= CONSTRAINT_LOG_LIKELIHOOD)
            assert found.loss == pytest.approx(every.loss, rel=0.05, nan_ok=True)
            assert (found.best is None) == (every.best is None)
            assert found.by_rims == pytest.approx(every.by_rims, nan_ok=True)
