from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.synth.cameras import Scanner
from dqreg.synth.coverage import visible_share
from dqreg.synth.noise import Noise
from dqreg.synth.parts import box, bracket, cylinder
from dqreg.synth.patterns import Lidar, StructuredLight
from dqreg.synth.raycast import centre_and_diagonal, first_hits, joined
from dqreg.synth.scanner import scan_mesh

VIEWS = ((1.0, -0.8, 0.9), (-0.5, 0.4, 1.0))
SCANNERS = [
    Scanner(views=VIEWS, pixels=24),
    StructuredLight(views=VIEWS, pixels=24),
    Lidar(views=VIEWS, rings=12, azimuths=40),
]


def spherical(rays, forward, up):
    """Azimuth and elevation of rays, by angles to the axes: independent of how they are made."""
    elevation = np.pi / 2 - np.arccos(rays @ up)
    level = forward - (forward @ up) * up
    left = np.cross(up, level / np.linalg.norm(level))
    return np.arctan2(rays @ left, rays @ level / np.linalg.norm(level)), elevation


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.3, -0.5, 0.8)])
def test_lidar_beams_lie_on_rings_of_equal_elevation_and_columns_of_equal_azimuth(up):
    scanner = Lidar(views=VIEWS, rings=16, azimuths=90, up=up, elevation_rad=0.4, azimuth_rad=1.2)
    axis = np.array(up) / np.linalg.norm(up)
    for view, rays in zip(VIEWS, scanner.ray_directions(), strict=True):
        forward = -np.array(view) / np.linalg.norm(view)
        azimuth, elevation = spherical(rays, forward, axis)
        np.testing.assert_allclose(elevation, elevation[:, :1] * np.ones(90), atol=1e-12)
        np.testing.assert_allclose(azimuth, azimuth[:1] * np.ones((16, 1)), atol=1e-12)
        np.testing.assert_allclose(np.diff(elevation[:, 0]), 0.4 / 16, atol=1e-12)
        np.testing.assert_allclose(np.diff(azimuth[0]), 1.2 / 90, atol=1e-12)
        np.testing.assert_allclose(azimuth[0].mean(), 0.0, atol=1e-12)
        np.testing.assert_allclose(elevation.mean(), np.arcsin(forward @ axis), atol=1e-12)


def test_a_full_turn_has_no_seam():
    rays = Lidar(views=((1, 0, 0.2),), rings=1, azimuths=36, azimuth_rad=2 * np.pi).ray_directions()[0, 0]
    steps = np.einsum("ni,ni->n", rays, np.roll(rays, -1, axis=0))
    np.testing.assert_allclose(steps, steps[0], atol=1e-12)


@pytest.mark.parametrize("view", [(1.0, 0.0, 0.0), (1.0, 0.0, 1.5)])
def test_default_lidar_just_takes_in_the_sphere_about_the_part(view):
    # Every point of the sphere of diameter S about the centre lies between the outermost beams.
    scanner = Lidar(views=(view,), rings=50, azimuths=50)
    sensor = scanner.sensor_positions(np.zeros(3), 1.0)[0]
    on_sphere = np.random.default_rng(0).standard_normal((200_000, 3))
    on_sphere *= 0.5 / np.linalg.norm(on_sphere, axis=1, keepdims=True)
    way = on_sphere - sensor
    forward, up = -sensor / np.linalg.norm(sensor), np.array([0.0, 0.0, 1.0])
    seen = spherical(way / np.linalg.norm(way, axis=1, keepdims=True), forward, up)
    beams = spherical(scanner.ray_directions()[0], forward, up)
    for of_sphere, of_beams in zip(seen, beams, strict=True):
        edge = np.ptp(of_beams) * 50 / 49  # from the outer edge of the first to that of the last
        assert np.ptp(of_sphere) == pytest.approx(edge, rel=0.01)


def test_lidar_times_follow_the_columns():
    times = Lidar(views=VIEWS, rings=3, azimuths=10).times()
    assert times.shape == (2, 3, 10)
    np.testing.assert_array_equal(times[:, 0], times[:, 2])
    np.testing.assert_allclose(np.diff(times[:, 0].ravel()), 1 / 20, atol=1e-15)
    assert 0.0 < times.min() < times.max() < 1.0


@pytest.mark.parametrize("scanner", SCANNERS)
def test_a_shift_of_one_pixel_is_the_next_ray(scanner):
    # Of a pinhole and of a LiDAR: the ray one step to the side goes where the neighbour's goes.
    rays = scanner.ray_directions()
    shift = np.zeros((*rays.shape[:3], 2))
    shift[..., 0] = 1.0
    np.testing.assert_allclose(scanner.ray_directions(shift)[:, :, :-1], rays[:, :, 1:], atol=1e-12)
    np.testing.assert_allclose(scanner.ray_directions(shift[..., ::-1])[:, :-1], rays[:, 1:], atol=1e-12)
    np.testing.assert_allclose(scanner.ray_directions(0.0 * shift), rays, atol=1e-15)


@pytest.mark.parametrize("scanner", SCANNERS)
def test_noise_free_points_lie_on_the_part(scanner):
    vertices, faces = bracket()
    scan = scan_mesh(vertices, faces, scanner, rng=np.random.default_rng(0))
    plane = vertices[faces[scan.face_index, 0]]
    assert np.abs(np.einsum("ni,ni->n", scan.points - plane, scan.normals)).max() < 1e-12 * 156
    assert scan.on_part.all()
    assert len(scan.times) == len(scan.points)


def test_structured_light_keeps_what_the_projector_sees_and_nothing_else():
    # Oracle: rays from the projector, which must not be stopped before the point.
    vertices, faces = bracket()
    plain = Scanner(views=VIEWS, pixels=60)
    light = StructuredLight(views=VIEWS, pixels=60, baseline=0.6)
    whole, lit = (scan_mesh(vertices, faces, s, rng=np.random.default_rng(0)) for s in (plain, light))
    centre, diagonal = centre_and_diagonal(vertices)
    projectors = light.projector_positions(centre, diagonal)
    np.testing.assert_allclose(np.linalg.norm(projectors - lit.sensor_positions, axis=1), 0.6 * diagonal)
    way = whole.points - projectors[whole.view_index]
    _, first = first_hits(vertices, faces, projectors[whole.view_index], way)
    reached = np.linalg.norm(first - whole.points, axis=1) < 1e-6 * diagonal
    cosine = -np.einsum("ni,ni->n", way, whole.normals) / np.linalg.norm(way, axis=1)
    expected = whole.points[reached & (cosine > np.cos(Noise().max_incidence_rad))]
    np.testing.assert_array_equal(lit.points, expected)
    assert 0.5 < len(lit.points) / len(whole.points) < 0.95


def test_a_wall_casts_a_shadow_to_the_side_away_from_the_projector():
    # A post of 4 x 4 x 4 on a floor; the projector stands at +x, so the floor behind the post, at -x, stays dark.
    floor, faces = box(size=(40.0, 40.0, 1.0))
    post = box(size=(4.0, 4.0, 4.0))
    vertices, both = joined((floor, faces), (post[0] + [0.0, 0.0, 2.5], post[1]))
    scanner = StructuredLight(views=((0, 0, 1),), pixels=120, baseline=0.8)
    scan = scan_mesh(vertices, both, scanner, rng=np.random.default_rng(0))
    on_floor = scan.points[np.abs(scan.points[:, 2] - 0.5) < 1e-9]
    beside = np.abs(on_floor[:, 1]) < 1.5
    centre, S = centre_and_diagonal(vertices)
    # Similar triangles: the light over the post's upper edge meets the floor at this x.
    light = centre + np.array([0.8 * S, 0.0, 1.5 * S])
    edge = np.array([-2.0, 0.0, 4.5])
    end = edge[0] - (light[0] - edge[0]) * (edge[2] - 0.5) / (light[2] - edge[2])
    assert not ((on_floor[beside, 0] > end + 0.01) & (on_floor[beside, 0] < -2.01)).any()
    assert ((on_floor[beside, 0] < end - 0.01) & (on_floor[beside, 0] > end - 3.0)).any()
    assert ((on_floor[beside, 0] > 2.4) & (on_floor[beside, 0] < 4.0)).any()


def test_coverage_counts_what_both_see():
    views = ((0, 0, 1),)
    # From afar the camera sees the top of a cylinder, and so does a projector beside it; the sides neither of them.
    alone = visible_share(*cylinder(), Scanner(views=((1, 0, 0),), stand_off=50.0))
    both = visible_share(*cylinder(), StructuredLight(views=((1, 0, 0),), stand_off=5.0, baseline=5.0))
    side = np.pi / (np.pi + np.pi / 2)  # share of the side of a cylinder with diameter and height 1
    assert alone == pytest.approx(side / 2, abs=0.02)
    # Seen from 45 degrees to the side, a quarter of the way round is hidden from the projector.
    assert side * 0.3 < both < side * 0.42
    hidden = visible_share(*box(), Scanner(views=views), surroundings=(box()[0] + [0.0, 0.0, 1.0], box()[1]))
    assert hidden == 0.0


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Lidar(views=()), "views"),
        (lambda: Lidar(views=((0, 0, 1),)), "axis of the spin"),
        (lambda: Lidar(views=VIEWS, rings=0), "rings"),
        (lambda: Lidar(views=VIEWS, azimuths=2.5), "azimuths"),
        (lambda: Lidar(views=VIEWS, rings=100_000, azimuths=100_000), "rings is too large"),
        (lambda: Lidar(views=VIEWS, up=(0, 0, 0)), "up"),
        (lambda: Lidar(views=VIEWS, azimuth_rad=7.0), "azimuth_rad"),
        (lambda: Lidar(views=VIEWS, elevation_rad="wide"), "elevation_rad"),
        (lambda: StructuredLight(views=VIEWS, baseline=0.0), "baseline"),
        (lambda: StructuredLight(views=VIEWS, baseline="1"), "baseline"),
        (lambda: StructuredLight(views=VIEWS, pixels=0), "pixels"),
        (lambda: Scanner(views=VIEWS, pixels=1_000_000), "pixels is too large"),
        (lambda: Scanner(views=VIEWS, stand_off=1e9), "stand_off"),
    ],
)
def test_impossible_settings_are_named(make, word):
    with pytest.raises(InputError, match=word):
        make()
