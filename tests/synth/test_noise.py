"""Each noise model against its definition; five standard errors of the count at hand are the tolerance."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.synth.cameras import Scanner
from dqreg.synth.noise import Noise
from dqreg.synth.parts import box, bracket
from dqreg.synth.patterns import Lidar
from dqreg.synth.raycast import joined
from dqreg.synth.scanner import quantised, scan_mesh

# A plate seen from straight above: one plane, all angles of incidence up to 20 degrees.
FLAT = box(size=(100.0, 100.0, 1.0))
ABOVE = Scanner(views=((0.0, 0.0, 1.0),), pixels=150)


def scan_flat(noise: Noise, seed: int = 0, scanner: Scanner = ABOVE, motion=None):
    return scan_mesh(*FLAT, scanner, noise, rng=np.random.default_rng(seed), motion=motion)


def test_lateral_noise_moves_points_across_their_rays_by_the_stated_share_of_a_pixel():
    exact, noisy = scan_flat(Noise()), scan_flat(Noise(lateral_sigma=0.4))
    assert len(exact.points) == len(noisy.points)  # nothing else changes
    sensor = exact.sensor_positions[0]
    ways = [s.points - sensor for s in (exact, noisy)]
    ranges = [np.linalg.norm(w, axis=1) for w in ways]
    np.testing.assert_allclose(*ranges, rtol=1e-12)  # the range is that of the middle of the pixel
    # On the image plane at depth 1 a pixel is 2 tan(opening / 2) / pixels wide.
    pitch = 2.0 * np.tan(ABOVE.opening_rad / 2) / ABOVE.pixels
    image = [w[:, :2] / -w[:, 2:] for w in ways]
    off = (image[1] - image[0]) / pitch
    count = len(off)
    assert (np.abs(off.mean(axis=0)) < 5 * 0.4 / np.sqrt(count)).all()
    assert (np.abs(off.std(axis=0) - 0.4) < 5 * 0.4 / np.sqrt(2 * count)).all()
    assert abs(np.corrcoef(off.T)[0, 1]) < 5 / np.sqrt(count)


def test_total_sigma_is_the_spread_off_the_face_along_the_ray():
    noise = Noise(range_sigma=0.05, lateral_sigma=0.5, grazing_growth=0.5)
    scanner = Lidar(views=((1.0, -0.8, 0.9),), rings=150, azimuths=200)
    vertices, faces = bracket()
    scan = scan_mesh(vertices, faces, scanner, noise, rng=np.random.default_rng(0))
    corner = vertices[faces[scan.face_index, 0]]
    true_cosine = np.einsum("ni,ni->n", scan.ray_directions, scan.normals)
    along = np.einsum("ni,ni->n", scan.points - corner, scan.normals) / true_cosine
    # The ray that is read differs from the true one by half a pixel: 1 % of the slope on most faces.
    flat = np.abs(true_cosine) > 0.35
    normalised = (along / scan.total_sigma)[flat]
    assert flat.sum() > 5_000
    assert abs(normalised.std() - 1.0) < 5 / np.sqrt(2 * flat.sum()) + 0.01
    assert (scan.total_sigma > scan.range_sigma).all()


def test_quantisation_is_exact():
    for scan in (scan_flat(Noise(quantisation=0.25, range_sigma=0.3)),
                 scan_flat(Noise(quantisation=0.25, outlier_share=0.5, lateral_sigma=0.3))):  # fmt: skip
        steps = np.linalg.norm(scan.points - scan.sensor_positions[0], axis=1) / 0.25
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
        assert len(np.unique(np.round(steps))) > 5


def test_quantisation_rounds_to_the_nearest_step_on_the_same_ray():
    exact, coarse = scan_flat(Noise(range_sigma=0.3)), scan_flat(Noise(range_sigma=0.3, quantisation=0.25))
    np.testing.assert_allclose(coarse.ray_directions, exact.ray_directions, atol=1e-12)
    off = np.einsum("ni,ni->n", coarse.points - exact.points, exact.ray_directions)
    assert np.abs(off).max() <= 0.125 + 1e-9
    # Uniform rounding errors: sigma = step / sqrt(12), to five standard errors of a uniform spread.
    assert abs(off.std() - 0.25 / np.sqrt(12)) < 5 * 0.25 / np.sqrt(12) * np.sqrt(0.2 / len(off))
    np.testing.assert_array_equal(quantised(coarse.points, coarse.sensor_positions[:1], 0.25).round(9),
                                  coarse.points.round(9))  # fmt: skip


def test_dropout_grows_with_the_angle_as_stated():
    # Two faces of one box, seen at 30 and 60 degrees off their normals.
    scanner = Scanner(views=((np.sin(np.pi / 6), 0.0, np.cos(np.pi / 6)),), pixels=200, stand_off=50.0)
    full, thin = (
        scan_mesh(*box(size=(1.0, 1.0, 1.0)), scanner, Noise(dropout=d), rng=np.random.default_rng(1))
        for d in (0.0, 0.8)
    )
    kept = []
    for axis, angle in ((2, np.pi / 6), (0, np.pi / 3)):
        before, after = (int((s.normals[:, axis] > 0.5).sum()) for s in (full, thin))
        lost = 0.8 * (1 - np.cos(angle))
        # From 50 diagonals away the angle varies by half a degree over the box, the loss by 0.6 %.
        assert abs(after / before - (1 - lost)) < 5 * np.sqrt(lost * (1 - lost) / before) + 0.007
        kept.append(after / before)
    assert kept[0] > kept[1] + 0.2


def test_grazing_noise_follows_its_law_face_by_face():
    scanner = Scanner(views=((np.sin(np.pi / 6), 0.0, np.cos(np.pi / 6)),), pixels=200, stand_off=50.0)
    noise = Noise(range_sigma=0.01, grazing_growth=1.5)
    scan = scan_mesh(*box(), scanner, noise, rng=np.random.default_rng(2))
    for axis, angle in ((2, np.pi / 6), (0, np.pi / 3)):
        on = scan.normals[:, axis] > 0.5
        along = (scan.points[on, axis] - 0.5) / scan.ray_directions[on, axis]
        sigma = 0.01 * (1 + 1.5 * (1 / np.cos(angle) - 1))
        assert abs(along.std() - sigma) < sigma * (5 / np.sqrt(2 * on.sum()) + 0.02)


@pytest.mark.parametrize("scanner", [ABOVE, Lidar(views=((0.3, 0, 1.0),), rings=100, azimuths=100, stand_off=4.0)])
def test_mixed_pixels_lie_on_their_rays_between_the_two_surfaces(scanner):
    low, high = box(size=(20.0, 20.0, 1.0)), box(size=(5.0, 5.0, 1.0))
    mesh = joined(low, (high[0] + [0.0, 0.0, 10.0], high[1]))
    clean = scan_mesh(*mesh, scanner, rng=np.random.default_rng(0))
    scan = scan_mesh(*mesh, scanner, Noise(mixed_share=0.6), rng=np.random.default_rng(0))
    mixed = scan.points[scan.is_outlier]
    assert 10 < len(mixed) < 0.05 * len(scan.points)
    z = mixed[:, 2]
    assert ((z > -0.5) & (z < 10.5)).all()
    assert ((z > 1.5) & (z < 9.5)).sum() > 5
    # Each is on the ray of a pixel: the same place in the image as a point of the clean scan.
    gaps = (scan.ray_directions[scan.is_outlier] @ clean.ray_directions.T).max(axis=1)
    assert gaps.min() > 1 - 1e-14


def test_mixed_pixels_have_their_share_of_the_steps():
    # A comb of bars: the share is that of pixels whose neighbour in the row is over the next depth.
    bars = [(box(size=(2.0, 40.0, 2.0))[0] + [4.0 * k - 20.0, 0, 5.0], box()[1]) for k in range(11)]
    mesh = box(size=(60.0, 60.0, 1.0))
    for bar in bars:
        mesh = joined(mesh, bar)
    scanner = Scanner(views=((0, 0, 1),), pixels=250)
    edges = scan_mesh(*mesh, scanner, Noise(mixed_share=1.0), rng=np.random.default_rng(0)).is_outlier.sum()
    share = scan_mesh(*mesh, scanner, Noise(mixed_share=0.3), rng=np.random.default_rng(1)).is_outlier.sum()
    assert edges > 1000
    assert abs(share - 0.3 * edges) < 5 * np.sqrt(0.3 * 0.7 * edges)


def test_new_noise_takes_nothing_from_the_generator_where_it_is_off():
    # What is drawn for the old models stays as it was: same bytes with and without the keys.
    one = scan_flat(Noise(range_sigma=0.1, outlier_share=0.1))
    two = scan_flat(Noise(range_sigma=0.1, outlier_share=0.1, lateral_sigma=0.0, quantisation=0.0))
    assert one.points.tobytes() == two.points.tobytes()
    lateral = scan_flat(Noise(range_sigma=0.1, outlier_share=0.1, lateral_sigma=0.3))
    np.testing.assert_array_equal(lateral.is_outlier, one.is_outlier)
    np.testing.assert_array_equal(lateral.points[lateral.is_outlier], one.points[one.is_outlier])


@pytest.mark.parametrize("name", ["range_sigma", "quantisation"])
def test_lengths_that_cannot_belong_to_the_part_are_named(name):
    with pytest.raises(InputError, match=f"{name}.*tenth of the part's diagonal.*unit of the part"):
        scan_flat(Noise(**{name: 50.0}))


@pytest.mark.parametrize("name", ["lateral_sigma", "quantisation"])
@pytest.mark.parametrize("value", [-1.0, float("inf"), "much", True])
def test_impossible_settings_are_named(name, value):
    with pytest.raises(InputError, match=name):
        Noise(**{name: value})
