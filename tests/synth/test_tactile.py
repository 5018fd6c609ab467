from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh

from dqreg.errors import InputError
from dqreg.synth.parts import box, bracket, plate
from dqreg.synth.raycast import joined
from dqreg.synth.scan import Scan
from dqreg.synth.tactile import TactileProbe, touch_mesh


def distances(mesh, points):
    return trimesh.proximity.closest_point_naive(trimesh.Trimesh(*mesh, process=False), points)[1]


def test_points_of_contact_lie_on_the_part_with_its_exact_normals():
    scan = touch_mesh(*bracket(), TactileProbe(points=60, probe_radius=2.0), rng=np.random.default_rng(0))
    vertices, faces = bracket()
    assert scan.points.shape == (60, 3)
    assert distances((vertices, faces), scan.points).max() < 1e-12 * 156
    expected = trimesh.Trimesh(vertices, faces, process=False).face_normals[scan.face_index]
    np.testing.assert_allclose(scan.normals, expected, atol=1e-12)
    np.testing.assert_array_equal(scan.ray_directions, -scan.normals)
    assert scan.on_part.all()


def test_without_compensation_the_centres_of_the_ball_are_given():
    # The same seed touches the same places; the centres lie one radius off the surface, all around it.
    probe = TactileProbe(points=60, probe_radius=2.0)
    contacts = touch_mesh(*bracket(), probe, rng=np.random.default_rng(0))
    centres = touch_mesh(*bracket(), dataclasses.replace(probe, compensated=False), rng=np.random.default_rng(0))
    np.testing.assert_allclose(centres.points, contacts.points + 2.0 * contacts.normals, atol=1e-12)
    np.testing.assert_allclose(distances(bracket(), centres.points), 2.0, rtol=1e-8)


def test_a_ball_does_not_go_where_it_does_not_fit():
    # Holes of 9 and 14 mm: a ball of 4.4 mm radius enters both, one of 6 mm the large one only.
    def touched_walls(radius):
        probe = TactileProbe(points=1500, probe_radius=radius, max_tilt_rad=np.deg2rad(89))
        scan = touch_mesh(*plate((100.0, 60.0, 20.0)), probe, rng=np.random.default_rng(1))
        inside = (np.abs(scan.points - [50.0, 30.0, 10.0]) < [49.0, 29.0, 11.0]).all(axis=1)
        walls = scan.points[inside & (np.abs(scan.normals[:, 2]) < 0.1)]
        return {bool(np.hypot(*(p[:2] - [25.0, 15.0])) < 8.0) for p in walls}

    assert touched_walls(0.0) == {True, False}
    assert touched_walls(6.0) <= {True}


def test_the_way_out_is_free():
    # Two blocks with a slot of 0.02 between them: narrower than the stroke of S / 32, so nobody touches its walls.
    left, faces = box()
    mesh = joined((left, faces), (left + np.array([1.02, 0.0, 0.0]), faces))
    scan = touch_mesh(*mesh, TactileProbe(points=400), rng=np.random.default_rng(0))
    stroke = np.linalg.norm([2.02, 1.0, 1.0]) / 32
    np.testing.assert_allclose(scan.sensor_positions, scan.points + stroke * scan.normals, atol=1e-12)
    assert not ((scan.points[:, 0] > 0.499) & (scan.points[:, 0] < 0.521) & (np.abs(scan.normals[:, 0]) > 0.5)).any()
    outer = np.abs(np.abs(scan.points[:, 0] - 0.51) - 1.01) < 1e-9
    assert outer.any()


def test_noise_lies_along_the_normal_with_its_sigma():
    probe = TactileProbe(points=3000)
    exact = touch_mesh(*box(), probe, rng=np.random.default_rng(0))
    noisy = touch_mesh(*box(), probe, 0.01, rng=np.random.default_rng(0))
    off = noisy.points - exact.points
    along = np.einsum("ni,ni->n", off, exact.normals)
    np.testing.assert_allclose(off, along[:, None] * exact.normals, atol=1e-15)
    # Five standard errors of a mean and of a standard deviation.
    assert abs(along.mean()) < 5 * 0.01 / np.sqrt(3000)
    assert abs(along.std() - 0.01) < 5 * 0.01 / np.sqrt(6000)
    assert (noisy.range_sigma == 0.01).all()


def test_only_sides_in_reach_are_touched():
    probe = TactileProbe(points=300, views=((0, 0, 1), (1, 0, 0)), max_tilt_rad=np.deg2rad(30))
    scan = touch_mesh(*bracket(), probe, rng=np.random.default_rng(0))
    towards = (scan.normals @ np.array([[0.0, 0, 1], [1, 0, 0]]).T).max(axis=1)
    assert towards.min() >= np.cos(np.deg2rad(30)) - 1e-12
    assert {tuple(n) for n in scan.normals.round(6)} >= {(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)}


def test_touches_are_spread_by_area():
    scan = touch_mesh(*box(size=(4.0, 2.0, 1.0)), TactileProbe(points=4000), rng=np.random.default_rng(3))
    share = np.array([(np.abs(scan.normals[:, k]) > 0.5).mean() for k in range(3)])
    expected = np.array([2.0, 4.0, 8.0]) / 14.0
    assert (np.abs(share - expected) < 5 * np.sqrt(expected * (1 - expected) / 4000)).all()


def test_same_seed_same_bytes():
    one, two = (touch_mesh(*bracket(), TactileProbe(), 0.1, rng=np.random.default_rng(4)) for _ in range(2))
    for field in dataclasses.fields(Scan):
        assert getattr(one, field.name).tobytes() == getattr(two, field.name).tobytes()


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: TactileProbe(points=0), "points"),
        (lambda: TactileProbe(points=10**9), "points"),
        (lambda: TactileProbe(probe_radius=-1.0), "probe_radius"),
        (lambda: TactileProbe(probe_radius="2 mm"), "probe_radius"),
        (lambda: TactileProbe(compensated=1), "compensated"),
        (lambda: TactileProbe(views=((0, 0, 0),)), "views"),
        (lambda: TactileProbe(max_tilt_rad=2.0), "max_tilt_rad"),
        (lambda: touch_mesh(*box(), TactileProbe(probe_radius=1.0), rng=np.random.default_rng(0)), "unit of the part"),
        (lambda: touch_mesh(*box(), TactileProbe(), 1.0, rng=np.random.default_rng(0)), "sigma"),
        (
            lambda: touch_mesh(
                *box(), TactileProbe(views=((1, 1, 1),), max_tilt_rad=0.5), rng=np.random.default_rng(0)
            ),
            "reaches only 0 of 2000",
        ),
    ],
)
def test_impossible_settings_are_named(make, word):
    with pytest.raises(InputError, match=word):
        make()
