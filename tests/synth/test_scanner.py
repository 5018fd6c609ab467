from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh

from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.synth.cameras import Scanner
from dqreg.synth.coverage import visible_share
from dqreg.synth.noise import Noise
from dqreg.synth.parts import box, bracket
from dqreg.synth.scan import Scan
from dqreg.synth.scanner import scan_mesh

SIZE = 156.2  # diagonal of the default bracket
VIEWS = ((1.0, -0.8, 0.9), (-0.45, 0.2, 1.0))


def scan_bracket(noise: Noise | None = None, seed: int = 0, pixels: int = 80) -> Scan:
    return scan_mesh(*bracket(), Scanner(views=VIEWS, pixels=pixels), noise, rng=np.random.default_rng(seed))


def range_errors(scan: Scan) -> np.ndarray:
    """Signed distance of each inlier from the plane of its face, along its ray."""
    vertices, faces = bracket()
    good = ~scan.is_outlier
    on_plane = vertices[faces[scan.face_index[good], 0]]
    off_plane = np.einsum("ni,ni->n", scan.points[good] - on_plane, scan.normals[good])
    return off_plane / np.einsum("ni,ni->n", scan.ray_directions[good], scan.normals[good])


def test_noise_free_points_lie_on_their_faces():
    scan = scan_bracket()
    vertices, faces = bracket()
    on_face = trimesh.triangles.closest_point(vertices[faces[scan.face_index]], scan.points)
    np.testing.assert_allclose(scan.points, on_face, atol=1e-12 * SIZE)


def test_noise_free_points_lie_on_the_mesh():
    # An oracle that knows nothing of the face index.
    scan = scan_bracket(pixels=20)
    _, distance, _ = trimesh.proximity.closest_point_naive(trimesh.Trimesh(*bracket(), process=False), scan.points)
    assert len(distance) > 100
    assert distance.max() < 1e-12 * SIZE


@pytest.mark.parametrize("noise", [None, Noise(range_sigma=0.1, outlier_share=0.1, mixed_share=0.5)])
def test_rays_are_unit_lead_from_sensor_to_point_and_meet_front_faces(noise):
    scan = scan_bracket(noise)
    np.testing.assert_allclose(np.linalg.norm(scan.ray_directions, axis=1), 1.0, rtol=1e-14)
    away = scan.points - scan.sensor_positions[scan.view_index]
    distances = np.linalg.norm(away, axis=1)
    np.testing.assert_allclose(away / distances[:, None], scan.ray_directions, atol=1e-13)
    good = ~scan.is_outlier
    assert (np.einsum("ni,ni->n", scan.normals, scan.ray_directions)[good] < 0.0).all()


def test_sensors_stand_where_asked():
    scan = scan_bracket()
    vertices, _ = bracket()
    centre, diagonal = 0.5 * vertices.max(axis=0), np.linalg.norm(vertices.max(axis=0))
    away = scan.sensor_positions - centre
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 1.5 * diagonal)
    np.testing.assert_allclose(np.cross(away, VIEWS), 0.0, atol=1e-10)


def test_a_default_image_just_takes_in_the_sphere_about_the_part():
    # The middle rays of the image's sides touch the sphere of diameter S, seen from 1.5 S.
    rays = Scanner(views=((0, 0, 1),), pixels=1001).ray_directions()[0]
    cosine = -rays[500, 0, 2]
    assert 1.5 * np.sqrt(1 - cosine**2) == pytest.approx(0.5, rel=2e-3)


def test_noise_has_the_asked_sigma_along_the_ray():
    sigma = 0.2
    errors = range_errors(scan_bracket(Noise(range_sigma=sigma), pixels=150))
    count = len(errors)
    # Five standard errors of a mean and of a standard deviation.
    assert abs(errors.mean()) < 5 * sigma / np.sqrt(count)
    assert abs(errors.std() - sigma) < 5 * sigma / np.sqrt(2 * count)


def test_noise_grows_with_incidence_as_stated():
    scan = scan_bracket(Noise(range_sigma=0.1, grazing_growth=2.0), pixels=150)
    cosine = -np.einsum("ni,ni->n", scan.ray_directions, scan.normals)
    np.testing.assert_allclose(scan.range_sigma, 0.1 * (1 + 2.0 * (1 / cosine - 1)), rtol=1e-9)
    normalised = range_errors(scan) / scan.range_sigma
    assert abs(normalised.std() - 1.0) < 5 / np.sqrt(2 * len(normalised))


def test_nothing_returns_beyond_the_largest_incidence():
    scan = scan_bracket(Noise(max_incidence_rad=np.deg2rad(50)))
    cosine = -np.einsum("ni,ni->n", scan.ray_directions, scan.normals)
    assert cosine.min() > np.cos(np.deg2rad(50))
    assert len(scan.points) < 0.9 * len(scan_bracket().points)


def test_dropout_loses_the_stated_share():
    full, thin = scan_bracket(pixels=150), scan_bracket(Noise(dropout=0.8), pixels=150)
    cosine = -np.einsum("ni,ni->n", full.ray_directions, full.normals)
    lost = 0.8 * (1 - cosine)
    expected, spread = (1 - lost).sum(), np.sqrt((lost * (1 - lost)).sum())
    assert abs(len(thin.points) - expected) < 5 * spread


def test_outliers_have_their_share_and_fill_their_box():
    share = 0.2
    scan = scan_bracket(Noise(outlier_share=share, outlier_box=1.5), pixels=150)
    count = len(scan.points)
    assert abs(scan.is_outlier.sum() - share * count) < 5 * np.sqrt(share * (1 - share) * count)
    vertices, _ = bracket()
    size = vertices.max(axis=0)
    in_box = (scan.points[scan.is_outlier] - 0.5 * size) / size  # within -0.75 to 0.75 on each axis
    assert np.abs(in_box).max() <= 0.75
    np.testing.assert_allclose(in_box.std(axis=0), 1.5 / np.sqrt(12), rtol=0.05)
    assert (scan.face_index[scan.is_outlier] == -1).all()
    assert np.isnan(scan.normals[scan.is_outlier]).all()
    assert np.isnan(scan.range_sigma[scan.is_outlier]).all()
    assert np.isfinite(scan.normals[~scan.is_outlier]).all()


def test_mixed_pixels_lie_between_the_two_sides_of_a_step():
    # Two boxes seen from above, their tops at 0.5 and 10.5: every depth step leads from one to the other.
    low, faces = box(size=(20.0, 20.0, 1.0))
    high, _ = box(size=(5.0, 5.0, 1.0))
    vertices, both = np.vstack([low, np.add(high, [0, 0, 10.0])]), np.vstack([faces, faces + len(low)])
    scanner = Scanner(views=((0, 0, 1),), pixels=100)
    scan = scan_mesh(vertices, both, scanner, Noise(mixed_share=0.5), rng=np.random.default_rng(0))
    z = scan.points[scan.is_outlier, 2]
    assert 10 < len(z) < 0.05 * len(scan.points)
    assert (z > 0.5).all()
    assert (z < 10.5).all()
    assert ((z > 1.5) & (z < 9.5)).any()


def test_same_seed_same_bytes_and_other_seed_other_bytes():
    noise = Noise(range_sigma=0.1, dropout=0.2, outlier_share=0.05, mixed_share=0.3)
    one, two, other = scan_bracket(noise, 5), scan_bracket(noise, 5), scan_bracket(noise, 6)
    for field in dataclasses.fields(Scan):
        assert getattr(one, field.name).tobytes() == getattr(two, field.name).tobytes()
    assert one.points.tobytes() != other.points.tobytes()


def test_one_pixel_more_or_less_changes_no_other_point():
    # Without its boss the bracket loses some points; all rays that meet the same spot keep their error.
    scanner, noise = Scanner(views=VIEWS[:1], pixels=60), Noise(range_sigma=0.1)
    short = scan_mesh(*bracket(boss_height=1e-3), scanner, noise, rng=np.random.default_rng(0))
    tall = scan_mesh(*bracket(), scanner, noise, rng=np.random.default_rng(0))
    base = [s.points[(s.normals[:, 2] > 0.99) & (s.points[:, 0] > 80)] for s in (short, tall)]
    assert len(base[0]) > 100
    np.testing.assert_allclose(*base, atol=1e-9)


def test_moving_a_scan_moves_all_of_it_alike():
    scan = scan_bracket(Noise(range_sigma=0.1, outlier_share=0.1))
    T = pose.random(np.random.default_rng(2), reach=100.0)
    there = scan.moved(T)
    away = there.points - there.sensor_positions[there.view_index]
    np.testing.assert_allclose(away, np.linalg.norm(away, axis=1, keepdims=True) * there.ray_directions, atol=1e-10)
    back = there.moved(pose.inverse(T))
    for field in dataclasses.fields(Scan):
        np.testing.assert_allclose(getattr(back, field.name), getattr(scan, field.name), atol=1e-11)


def test_arguments_stay_as_they_are():
    vertices, faces = bracket()
    kept = vertices.copy(), faces.copy()
    noise = Noise(range_sigma=0.1, outlier_share=0.1)
    scan_mesh(vertices, faces, Scanner(views=VIEWS, pixels=20), noise, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(vertices, kept[0])
    np.testing.assert_array_equal(faces, kept[1])


def test_an_open_mesh_shows_no_inside():
    # A box without its lid, seen from above: only the floor and walls from behind, which return nothing.
    vertices, faces = box()
    lid = (vertices[faces][:, :, 2] > 0).all(axis=1)
    with pytest.raises(InputError, match="no ray brought a point back"):
        scan_mesh(vertices, faces[~lid], Scanner(views=((0, 0, 1),), pixels=9), rng=np.random.default_rng(0))


def test_coverage_of_a_box_counts_its_faces():
    # From afar a view along (1, 1, 1) sees three of six faces; one along z sees the top only.
    assert visible_share(*box(), Scanner(views=((1, 1, 1),), stand_off=50.0)) == pytest.approx(0.5, abs=0.02)
    assert visible_share(*box(), Scanner(views=((0, 0, 1), (0, 0, -1)))) == pytest.approx(1 / 3, abs=0.02)
    low, faces = box(size=(9.0, 9.0, 1.0))
    vertices = np.vstack([low, np.add(low, [0.0, 0.0, 5.0])])  # from above, a second box hides behind the first
    twice = np.vstack([faces, faces + len(low)])
    share = visible_share(vertices, twice, Scanner(views=((0, 0, 1),), stand_off=50.0))
    assert share == pytest.approx(81 / (4 * 81 + 8 * 9), abs=0.02)
    tilted = Scanner(views=((1, 1, 1),), stand_off=50.0)
    assert visible_share(*box(), tilted, max_incidence_rad=np.deg2rad(50)) == 0.0  # each face is seen at 54.7 degrees


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Scanner(views=()), "views"),
        (lambda: Scanner(views=((0, 0, 0),)), "views"),
        (lambda: Scanner(views=((0, 0),)), "views"),
        (lambda: Scanner(views=VIEWS, pixels=0), "pixels"),
        (lambda: Scanner(views=VIEWS, pixels=1.5), "pixels"),
        (lambda: Scanner(views=VIEWS, stand_off=0.4), "stand_off"),
        (lambda: Scanner(views=VIEWS, stand_off="1"), "stand_off"),
        (lambda: Scanner(views=VIEWS, field_of_view_rad=4.0), "field_of_view_rad"),
        (lambda: Noise(range_sigma=-0.1), "range_sigma"),
        (lambda: Noise(range_sigma=float("nan")), "range_sigma"),
        (lambda: Noise(outlier_share=1.1), "outlier_share"),
        (lambda: Noise(max_incidence_rad=1.6), "max_incidence_rad"),
        (lambda: Noise(dropout="much"), "dropout"),
    ],
)
def test_impossible_settings_are_named(make, word):
    with pytest.raises(InputError, match=word):
        make()
