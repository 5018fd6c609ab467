"""The place where the beams of a sweep begin: the generator's, in any frame and unit."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import PointCloud
from dqreg.geometry.beams import BEAM_SINE, Beams, along_beams, beams_of
from dqreg.geometry.cells import Cells
from dqreg.geometry.voxels import VoxelCloud, cell_size
from dqreg.rigid import pose
from dqreg.synth.many_views import room_stops
from dqreg.synth.street import street, swept, with_range_noise
from tests.strategies import FloatArray

NOISE = 0.02


def sweep(seed: int, rings: int, noise: float = NOISE) -> FloatArray:
    """A street from 1.8 above it, in the sensor's frame."""
    rng, stand = np.random.default_rng(seed), np.eye(4)
    stand[2, 3] = 1.8
    angles = np.deg2rad(np.linspace(-25.0, 15.0, rings)), np.linspace(-np.pi, np.pi, 900, endpoint=False)
    return with_range_noise(swept(street(rng), stand, *angles), noise, rng)


def told(points: FloatArray) -> Beams:
    return beams_of(points, Cells.of(cloud := PointCloud(points), cell_size(cloud, len(points) // 3)).order)


@pytest.mark.parametrize("rings", [16, 32])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_beams_begin_at_the_sensor_in_any_frame_and_unit(rings: int, unit: float) -> None:
    T = pose.exp([0.3, -0.2, 1.0, 4.0, 5.0, 6.0])
    origin = told(unit * pose.apply(T, sweep(rings, rings))).origin
    assert origin is not None
    # Planes by noise alone turn by chance, and those along beams do not: a thousand of them tell its place to a few
    # standard deviations of one range.
    assert np.linalg.norm(origin / unit - T[:3, 3]) < 3.0 * NOISE


@pytest.mark.parametrize(("seed", "rings"), [(20_670, 32), (20_671, 32), (20_671, 16)])
def test_where_the_ground_is_cut_off_the_sensor_is_found_among_houses(seed: int, rings: int) -> None:
    # Sums of distances alone, from the middle of the points, led metres off where a fifth of the planes were others.
    points = sweep(seed, rings)
    beams = told(points[points[:, 2] > -1.6])
    assert beams.origin is not None
    # Houses stand 9 and more away: from there beams are off by less than the sine that counts.
    assert np.linalg.norm(beams.origin) < 9.0 * BEAM_SINE
    # Lines are told by how thin they are, and lie slanting to the beams: noise across them is less than along these.
    assert 0.5 * NOISE < beams.noise < 1.5 * NOISE


def test_exact_points_and_those_strewn_over_a_body_tell_no_beams() -> None:
    assert told(sweep(0, 16, 0.0)).origin is None
    ways = np.random.default_rng(1).normal(size=(10_000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    assert told(ways).origin is None
    assert told(ways[:50]).origin is None
    assert told(np.linspace(0.0, 1.0, 5_000)[:, None] * [1.0, 2.0, 3.0]).origin is None


def test_planes_of_beams_are_those_that_the_place_lies_in() -> None:
    points = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 1.0]])
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    assert along_beams(points, normals, np.zeros(3)).tolist() == [True, False]


@pytest.mark.parametrize("seed", [2, 3])
def test_hardly_a_cell_of_few_rings_has_a_plane_of_beams(seed: int) -> None:
    # One in ten had.
    surface = VoxelCloud.evened(PointCloud(sweep(seed, 16)), 6_000).surface
    assert surface is not None
    assert surface.of_few_rings
    normals = surface.normals
    held = normals.any(axis=1)
    assert 0.5 < held.mean() < 1.0
    assert along_beams(surface._points[held], normals[held], np.zeros(3)).mean() < 0.01


def test_a_room_of_many_rings_keeps_its_planes() -> None:
    cloud = PointCloud(np.asarray(room_stops(1, rings=48, rng=np.random.default_rng(5)).scans[0]))
    surface = VoxelCloud.evened(cloud, 6_000).surface
    assert surface is not None
    assert surface.normals.any(axis=1).mean() > 0.99
