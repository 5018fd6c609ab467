from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid import pose
from dqreg.synth.cameras import Scanner
from dqreg.synth.noise import Noise
from dqreg.synth.parts import bracket
from dqreg.synth.range_bound import cramer_rao_bound
from dqreg.synth.scanner import scan_mesh
from dqreg.synth.truth import rms_vertex_displacement

SIGMA = 0.05


def small_scan(noise=None):
    scanner = Scanner(views=((1.0, -0.8, 0.9), (-0.5, 0.6, -1.0)), pixels=25)
    return scan_mesh(*bracket(), scanner, noise, rng=np.random.default_rng(0))


def ranges_to_moved_planes(twist, scan):
    """Range of each ray to the plane of its face, once the part has been moved by a twist."""
    T = pose.exp(twist)
    normals, on_plane = pose.rotate(T, scan.normals), pose.apply(T, scan.points)
    sensors = scan.sensor_positions[scan.view_index]
    above = np.einsum("ni,ni->n", on_plane - sensors, normals)
    return above / np.einsum("ni,ni->n", scan.ray_directions, normals)


def test_agrees_with_a_finite_difference_fisher_matrix():
    # Nothing but the definition: ranges by intersecting rays with moved planes, vertices by moving them.
    scan, (vertices, _) = small_scan(), bracket()
    h, base = 1e-6, np.eye(6)
    J = [(ranges_to_moved_planes(h * e, scan) - ranges_to_moved_planes(-h * e, scan)) / (2 * h) for e in base]
    A = [(pose.apply(pose.exp(h * e), vertices) - pose.apply(pose.exp(-h * e), vertices)) / (2 * h) for e in base]
    covariance = np.linalg.inv(np.array(J) @ np.array(J).T / SIGMA**2)
    expected = np.sqrt(np.einsum("ivk,ij,jvk->", np.array(A), covariance, np.array(A)) / len(vertices))
    bound = cramer_rao_bound(scan.points, scan.ray_directions, scan.normals, SIGMA, vertices)
    assert bound == pytest.approx(expected, rel=1e-6)


def test_an_efficient_estimator_reaches_it():
    # Monte Carlo: one Gauss-Newton step from the truth on noisy ranges, which is efficient for small noise.
    scan, (vertices, _) = small_scan(), bracket()
    cosine = np.einsum("ni,ni->n", scan.normals, scan.ray_directions)
    J = np.hstack([np.cross(scan.points, scan.normals), scan.normals]) / cosine[:, None]
    noise = SIGMA * np.random.default_rng(1).standard_normal((len(J), 400))
    twists = np.linalg.lstsq(J, noise, rcond=None)[0].T
    squares = [rms_vertex_displacement(pose.exp(twist), np.eye(4), vertices) ** 2 for twist in twists]
    bound = cramer_rao_bound(scan.points, scan.ray_directions, scan.normals, SIGMA, vertices)
    # The mean square over 400 runs of some six degrees of freedom is good to about sqrt(2 / 400) = 7 %.
    assert np.mean(squares) == pytest.approx(bound**2, rel=0.2)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(-4, 4).map(lambda e: 10.0**e))
def test_does_not_depend_on_frame_and_follows_the_unit(seed, scale):
    scan, (vertices, _) = small_scan(), bracket()
    here = cramer_rao_bound(scan.points, scan.ray_directions, scan.normals, SIGMA, vertices)
    T = pose.random(np.random.default_rng(seed), reach=1e4)
    moved = scan.moved(T)
    there = cramer_rao_bound(
        scale * moved.points, -moved.ray_directions, -moved.normals, scale * SIGMA, scale * pose.apply(T, vertices)
    )
    assert there == pytest.approx(scale * here, rel=1e-9)


def test_twice_the_noise_twice_the_bound_and_one_sigma_a_point():
    scan, (vertices, _) = small_scan(Noise(range_sigma=SIGMA)), bracket()
    one = cramer_rao_bound(scan.points, scan.ray_directions, scan.normals, SIGMA, vertices)
    two = cramer_rao_bound(scan.points, scan.ray_directions, scan.normals, 2 * SIGMA, vertices)
    each = cramer_rao_bound(scan.points, scan.ray_directions, scan.normals, scan.range_sigma, vertices)
    assert two == pytest.approx(2 * one, rel=1e-12)
    assert each == pytest.approx(one, rel=1e-12)


def test_a_plane_alone_leaves_motions_free():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.normal(size=(50, 2)), np.zeros(50)])
    up = np.tile([0.0, 0.0, 1.0], (50, 1))
    with pytest.raises(DegenerateGeometryError, match="undetermined"):
        cramer_rao_bound(points, -up, up, SIGMA, points)


def test_bad_input_is_named():
    x, y = np.tile([1.0, 0.0, 0.0], (9, 1)), np.tile([0.0, 1.0, 0.0], (9, 1))
    with pytest.raises(InputError, match="along its surface"):
        cramer_rao_bound(x, x, y, SIGMA, x)
    with pytest.raises(InputError, match="sigma"):
        cramer_rao_bound(x, x, x, 0.0, x)
    with pytest.raises(InputError, match="go together"):
        cramer_rao_bound(x, x[:5], x, SIGMA, x)
    with pytest.raises(InputError, match="normals"):
        cramer_rao_bound(x, x, np.nan * x, SIGMA, x)
