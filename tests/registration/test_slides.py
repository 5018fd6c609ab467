"""Motions that few points constrain, on a bar: its ends decide where it is along its length."""

from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.geometry import sample_mesh
from dqreg.registration.assess import uncertainty_of
from dqreg.registration.fit import Fit, coarse_to_fine
from dqreg.registration.slides import slide_of, without_slide
from dqreg.rigid import pose
from dqreg.synth import worst_vertex_displacement
from dqreg.synth.parts import box
from dqreg.trust.limits import HOLDS, fewest_carriers
from tests.registration.scenes import problem_of

LENGTH, NOISE = 200.0, 0.05
BAR = dqreg.Mesh(*box((LENGTH, 30.0, 20.0)))
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


@pytest.mark.parametrize("on_ends", [6, 12])
def test_points_beyond_the_rim_hold_the_bar_where_few_points_lie_on_its_ends(on_ends: int) -> None:
    fit = fit_of(sides(on_ends), np.eye(4))
    assert (fit.information.carriers < fewest_carriers(float(fit.run.weights.sum()))).any()
    assert slide_of(fit).loss > 5.0 * HOLDS


def test_few_strays_hold_nothing() -> None:
    # The middle of the bar, and three points beside it where an end would be: each says little, and no rim is there.
    points = sides(0)
    middle = points[np.abs(points[:, 0] - BAR.centre[0]) < 0.3 * LENGTH]
    ends = np.array([BAR.centre + np.array([0.5 * LENGTH, 5.0 * k, 2.0 * k]) for k in (-1, 0, 1)])
    fit = fit_of(np.concatenate([middle, ends]), np.eye(4))
    assert fit.information.free.sum() == 1
    assert not slide_of(fit).loss >= HOLDS


def test_rims_alone_hold_the_bar_where_no_point_lies_on_its_ends() -> None:
    # The scan is made in the part's frame. Points of the long faces nearly reach both rims; no normal tells the length.
    fit = fit_of(almost_to_the_rims(), np.eye(4))
    assert fit.information.free.sum() == 1
    assert slide_of(fit).loss >= HOLDS
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


def test_a_pose_on_the_slope_is_gone_on_from() -> None:
    fit = fit_of(sides(12), np.eye(4)).at(OFF)
    assert worst_vertex_displacement(OFF, np.eye(4), BAR.vertices) > 0.019 * BAR.diagonal
    better, _ = without_slide(fit)
    off = worst_vertex_displacement(better.problem.to_caller(better.T_target_source), np.eye(4), BAR.vertices)
    # Twelve points fix the end to the noise over their root; six times that.
    assert off <= 6.0 * NOISE / np.sqrt(12.0)


def test_nothing_is_asked_where_enough_points_constrain_every_motion() -> None:
    assert np.isnan(slide_of(fit_of(sides(400), np.eye(4))).loss)
