"""What few rings of a LiDAR tell of their sensor, and what they do not."""

import numpy as np

from dqreg import Odometry
from dqreg.odometry import nees
from dqreg.odometry.map_surface import MapSurface
from dqreg.rigid import pose
from dqreg.synth.many_views import street_drive
from dqreg.synth.street import swept, with_range_noise
from tests.odometry.conftest import hall

NOISE = 0.02


def test_one_ring_does_not_tell_the_height_of_its_sensor():
    # Round every corner its points lie in the plane of its beams, and so do those of the next frame.
    rng, azimuths, odometry = np.random.default_rng(20_810), np.linspace(-np.pi, np.pi, 2_000), Odometry()
    for step in range(5):
        T = pose.from_parts(np.eye(3), [0.1 * step, 0.0, 0.0])
        result = odometry.register_frame(with_range_noise(swept(hall(), T, np.zeros(1), azimuths), 0.01, rng))
    free = [each.axis for each in result.observability if each.is_free and each.kind == "translation"]
    assert max(axis[2] for axis in free) > 0.9


def test_noise_along_the_beams_makes_no_plane_of_a_ring():
    rng = np.random.default_rng(20_811)
    ring = np.column_stack([rng.uniform(-3.0, 3.0, 300), NOISE * rng.normal(size=300), np.zeros(300)])
    queries = ring[:50]
    # A map that does not know of noise takes some places of it for planes.
    assert MapSurface(0.1, 12, 1.0, ring).planes_at(queries).normals.any()
    assert not MapSurface(0.1, 12, 1.0, ring, noise=NOISE).planes_at(queries).normals.any()
    # Of two rings on one wall the plane is that of the wall.
    wall = np.concatenate([ring, ring + np.array([0.0, 0.0, 0.15])])
    normals = MapSurface(0.1, 12, 1.0, wall, noise=NOISE).planes_at(queries).normals
    assert np.abs(normals[normals.any(axis=1), 1]).min() > 0.9


def test_a_plane_through_two_rings_counts_little_and_one_of_a_face_all():
    rng, size = np.random.default_rng(20_812), 0.4
    along, noise = rng.uniform(-3.0, 3.0, (2, 600)), 0.002 * rng.normal(size=(2, 600))
    # One on the ground, one on a wall: the plane through both is of neither.
    rings = np.concatenate([np.column_stack([along[0], noise[0] + 0.1, 0.0 * noise[0]]),
                            np.column_stack([along[1], noise[1] + 0.3, 0.2 + 0.0 * noise[1]])])  # fmt: skip
    face = np.column_stack([along[0], rng.uniform(-0.4, 0.8, 600), noise[0]])
    for points, least, most in ((rings, 0.19, 0.21), (face, 0.0, 0.05)):
        found = MapSurface(size, 12, 2.0, points).planes_at(points[:100])
        rough = np.sqrt(found.roughness[found.normals.any(axis=1)]) / (0.5 * size)
        assert len(rough) > 50
        assert least <= rough.min()
        assert np.median(rough) <= most


def test_covariances_of_few_rings_without_ground_are_of_the_size_of_the_errors():
    drive = street_drive(12, rings=16, rng=np.random.default_rng(20_800))
    odometry = Odometry()
    results = [odometry.register_frame(scan[scan[:, 2] > -1.6]) for scan in drive.scans]
    squares = nees(odometry.poses[1:], np.stack([r.covariance for r in results[1:]]), drive.T_world_scan[1:])
    # Six are expected; where planes of beams counted, 45.
    assert np.mean(squares) < 18.0
