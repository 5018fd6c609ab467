from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.synth.cameras import Scanner
from dqreg.synth.motion import Motion, poses_at
from dqreg.synth.noise import Noise
from dqreg.synth.parts import bracket
from dqreg.synth.patterns import Lidar, StructuredLight
from dqreg.synth.raycast import centre_and_diagonal
from dqreg.synth.scanner import scan_mesh

VIEWS = ((1.0, -0.8, 0.9), (-0.45, 0.2, 1.0))
MOTION = Motion(turn_rad=(0.03, -0.05, 0.1), shift=(0.05, 0.02, -0.04), reference=0.3)
SCANNERS = [
    Scanner(views=VIEWS, pixels=50),
    StructuredLight(views=VIEWS, pixels=50),
    Lidar(views=VIEWS, rings=40, azimuths=60),
]


def twist_of(motion: Motion) -> np.ndarray:
    return motion.twist(*centre_and_diagonal(bracket()[0]))


def off_face(scan) -> np.ndarray:
    """Signed distance of each point on the part from the plane of its own face."""
    vertices, faces = bracket()
    corner = vertices[faces[scan.face_index[scan.on_part], 0]]
    return np.einsum("ni,ni->n", scan.points[scan.on_part] - corner, scan.normals[scan.on_part])


def test_poses_are_the_matrix_exponential_of_the_twist():
    twist = np.array([0.2, -0.3, 0.5, 4.0, -5.0, 6.0])
    wx, wy, wz = twist[:3]
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = [[0, -wz, wy], [wz, 0, -wx], [-wy, wx, 0]]
    matrix[:3, 3] = twist[3:]
    times = np.array([-0.7, 0.0, 0.4, 1.0])
    np.testing.assert_allclose(poses_at(twist, times), [expm(t * matrix) for t in times], atol=1e-12)


def test_a_turn_leaves_the_centre_of_the_part_where_it_is():
    centre, diagonal = centre_and_diagonal(bracket()[0])
    T = poses_at(Motion(turn_rad=(0.3, 0.2, -0.5)).twist(centre, diagonal), np.array([1.0]))[0]
    np.testing.assert_allclose(pose.apply(T, centre), centre, atol=1e-12 * diagonal)
    T = poses_at(Motion(shift=(0.1, 0.0, 0.0)).twist(centre, diagonal), np.array([1.0]))[0]
    np.testing.assert_allclose(pose.apply(T, centre), centre + np.array([0.1 * diagonal, 0, 0]), atol=1e-12 * diagonal)


@pytest.mark.parametrize("scanner", SCANNERS)
def test_undoing_the_known_motion_puts_the_points_back_on_the_part(scanner):
    scan = scan_mesh(*bracket(), scanner, rng=np.random.default_rng(0), motion=MOTION)
    assert np.abs(off_face(scan)).max() > 1.0  # mm: as read they are not on it
    still = scan.undone(twist_of(MOTION), MOTION.reference)
    assert np.abs(off_face(still)).max() < 1e-12 * 1000
    # The normals, too, are again those of the faces.
    vertices, faces = bracket()
    a, b, c = np.moveaxis(vertices[faces[still.face_index]], 1, 0)
    normals = np.cross(b - a, c - a)
    np.testing.assert_allclose(still.normals, normals / np.linalg.norm(normals, axis=1, keepdims=True), atol=1e-12)


def test_with_noise_they_are_back_to_the_noise():
    sigma = 0.1
    noise = Noise(range_sigma=sigma)
    scan = scan_mesh(*bracket(), SCANNERS[0], noise, rng=np.random.default_rng(0), motion=MOTION)
    still = scan.undone(twist_of(MOTION), MOTION.reference)
    along = off_face(still) / np.einsum("ni,ni->n", still.ray_directions, still.normals)[still.on_part]
    assert abs(along.std() - sigma) < 5 * sigma / np.sqrt(2 * len(along))
    assert abs(along.mean()) < 5 * sigma / np.sqrt(len(along))


def test_rays_lead_from_the_resting_sensor_to_the_points_as_read():
    scan = scan_mesh(*bracket(), SCANNERS[2], rng=np.random.default_rng(0), motion=MOTION)
    away = scan.points - scan.sensor_positions[scan.view_index]
    np.testing.assert_allclose(away, np.linalg.norm(away, axis=1, keepdims=True) * scan.ray_directions, atol=1e-10)
    # The rays of a moving part are the beams of the pattern all the same.
    beams = SCANNERS[2].ray_directions().reshape(-1, 3)
    nearest = (scan.ray_directions @ beams.T).max(axis=1)
    assert nearest.min() > 1 - 1e-12


def test_a_motion_of_zero_is_rest():
    still = scan_mesh(*bracket(), SCANNERS[0], rng=np.random.default_rng(0))
    zero = scan_mesh(*bracket(), SCANNERS[0], rng=np.random.default_rng(0), motion=Motion())
    np.testing.assert_allclose(zero.points, still.points, atol=1e-10)


@pytest.mark.parametrize("reference", [0.0, 0.5, 1.0])
def test_at_the_reference_time_the_part_is_where_it_is(reference):
    motion = Motion(turn_rad=(0.0, 0.0, 0.4), reference=reference)
    scan = scan_mesh(*bracket(), Scanner(views=VIEWS[:1], pixels=101), rng=np.random.default_rng(0), motion=motion)
    off, apart = np.abs(off_face(scan)), np.abs(scan.times - reference)
    # Within one row's time the part turns by 0.4 / 101 rad, at most 78 mm from the centre.
    assert off[apart < 0.5 / 101].max(initial=0.0) < 0.4 / 101 * 78
    assert off[apart > 0.25].max() > 5.0


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Motion(turn_rad=(0.0, 0.0)), "turn_rad"),
        (lambda: Motion(turn_rad=(4.0, 0.0, 0.0)), "turn_rad.*half-turn"),
        (lambda: Motion(turn_rad="fast"), "turn_rad"),
        (lambda: Motion(shift=(np.nan, 0.0, 0.0)), "shift"),
        (lambda: Motion(shift=(100.0, 0.0, 0.0)), "shift"),
        (lambda: Motion(reference=1.5), "reference"),
        (lambda: Motion(reference=True), "reference"),
    ],
)
def test_impossible_settings_are_named(make, word):
    with pytest.raises(InputError, match=word):
        make()
