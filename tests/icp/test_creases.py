from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import noise_by_face
from dqreg.icp.correspondences import Correspondences, find_correspondences
from dqreg.icp.noise_by_face import (
    CREASE_SCALES,
    _constrain,
    _near,
    points_to_weighted_faces,
    without_creases,
)
from dqreg.rigid import pose
from dqreg.solvers.quadratic import plane_rows
from dqreg.solvers.row_sums import squared
from dqreg.synth.parts import box

SIDES = (3.0, 2.0, 1.0)
PART = Mesh(*box(SIDES))


def pairs_of(points: np.ndarray, part: Mesh = PART) -> Correspondences:
    """Pairs in the part's frame: the identity is the truth."""
    return find_correspondences(prepare_scan(PointCloud(points), 200), MeshSurface(part), np.eye(4))


def kept(pairs: Correspondences, width: float) -> np.ndarray:
    return without_creases(pairs, np.ones(len(pairs.distances)), width)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_places_near_a_crease_are_left_out_and_none_else(unit: float) -> None:
    width, part = 0.004 * unit, Mesh(*box(tuple(unit * side for side in SIDES)))
    rng = np.random.default_rng(0)
    pairs = pairs_of(sample_mesh(part, 20_000, rng).points + width * rng.normal(size=(20_000, 3)), part)
    # Each place is on one face of the box; the next one is as far as the crease. Two triangles of a face have none
    # between them, and one sees the other's at their two common corners alone.
    away = np.minimum(pairs.closest.points - part.bounds[0], part.bounds[1] - pairs.closest.points)
    crease = np.sort(np.abs(away), axis=1)[:, 1]
    left_out, near = kept(pairs, width) == 0.0, crease < CREASE_SCALES * width
    assert not left_out[~near].any()
    assert left_out[near].mean() > 0.99


def test_beside_a_blade_are_as_many_more_as_the_noise_carries_to_its_other_side() -> None:
    # A wedge of 20 degrees whose edge is the y axis: its upper face is as near as ten degrees' tangent of the distance.
    slope, margin = np.tan(np.deg2rad(20.0)), 0.012
    corners = np.array([[0.0, 0, 0], [3, 0, 0], [3, 0, 3 * slope], [0, 2, 0], [3, 2, 0], [3, 2, 3 * slope]])
    sides = [[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [0, 2, 5], [0, 5, 3], [1, 4, 5], [1, 5, 2]]
    wedge, rng = Mesh(corners, np.array(sides)), np.random.default_rng(0)
    x, y = 2.8 * rng.uniform(size=4_000) ** 3, rng.uniform(0.2, 1.8, 4_000)
    pairs = pairs_of(np.column_stack([x, y, np.zeros(4_000)]), wedge)
    places, surface = pairs.closest.points, pairs.surface
    assert isinstance(surface, MeshSurface)
    inside = (places[:, 0] < 2.5) & (places[:, 2] == 0.0)
    near = _near(pairs, surface, np.ones(len(places)), margin)[0]
    np.testing.assert_array_equal(near[inside], places[inside, 0] < margin / np.tan(np.deg2rad(10.0)))


def test_a_pose_departs_from_a_rotation_no_further_after_many_runs() -> None:
    """Held by creases and by the other points in turn: products with a transposed pose tripled what it departed by."""
    width, T = 0.02, np.eye(4)
    T[0, 1] = 1e-8
    rng = np.random.default_rng(2)
    # A slab without its rims: along them its creases alone hold it.
    samples = sample_mesh(PART, 20_000, rng)
    flat = np.abs(samples.normals[:, 2]) > 0.5
    points = samples.points[flat] + width * rng.normal(size=(int(flat.sum()), 3))
    scan = prepare_scan(PointCloud(points), 200)
    for _ in range(3):
        pairs = find_correspondences(scan, MeshSurface(PART), T)
        assert noise_by_face.motions_of_creases(pairs, np.ones(len(points)), width) is not None
        T = points_to_weighted_faces(pairs, np.ones(len(points)), width).T_target_source
    assert np.abs(T[:3, :3].T @ T[:3, :3] - np.eye(3)).max() <= 1.01e-8


def test_a_pose_of_range_data_is_more_accurate_without_them(monkeypatch: pytest.MonkeyPatch) -> None:
    # Two views with noise along their rays: a point of a face seen from above that is carried over an edge meets one
    # seen at a slant, whose points are more exact.
    rays = np.array([[-0.01, -0.05, -1.0], [0.01, 0.05, 0.7]])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    of_point = rays[np.arange(40_000) // 20_000]
    rng, errors = np.random.default_rng(1), {"without": [], "all": []}
    for _ in range(16):
        samples = sample_mesh(PART, 40_000, rng)
        seen = np.einsum("ij,ij->i", samples.normals, of_point) < 0.0
        points = (samples.points + 0.01 * rng.normal(size=(40_000, 1)) * of_point)[seen]
        for name, creases in (("without", without_creases), ("all", lambda pairs, weights, width: weights)):
            monkeypatch.setattr(noise_by_face, "without_creases", creases)
            pairs = pairs_of(points)
            T = points_to_weighted_faces(pairs, np.ones(len(points)), 0.006).T_target_source
            errors[name].append(float(np.linalg.norm(pose.apply(T, PART.vertices) - PART.vertices)))
    without, every = (np.sqrt(np.mean(np.square(errors[name]))) for name in ("without", "all"))
    assert without < 0.9 * every


def test_where_they_hold_a_motion_they_count() -> None:
    # A sheet: its walls are lower than what is near a crease, and nothing else holds it in its plane.
    sheet, rng = Mesh(*box((3.0, 2.0, 0.02))), np.random.default_rng(2)
    pairs = pairs_of(sample_mesh(sheet, 20_000, rng).points + 0.01 * rng.normal(size=(20_000, 3)), sheet)
    np.testing.assert_array_equal(kept(pairs, 0.01), 1.0)


def test_where_creases_are_everywhere_all_points_count() -> None:
    # Roofs of 45 degrees, two units wide: three widths of 0.25 from their ridges and valleys is most of them.
    x = np.arange(31.0)
    vertices = np.stack([np.repeat(x, 2), np.tile([0.0, 30.0], 31), np.repeat(x % 2.0, 2)], axis=1)
    first = 2 * np.arange(30)[:, None, None]
    faces = (first + np.array([[0, 2, 3], [0, 3, 1]])).reshape(-1, 3)
    roofs, rng = Mesh(vertices, faces), np.random.default_rng(3)
    for width, is_fine in ((0.25, True), (0.01, False)):
        pairs = pairs_of(sample_mesh(roofs, 5_000, rng).points + width * rng.normal(size=(5_000, 3)), roofs)
        left_out = np.mean(kept(pairs, width) == 0.0)
        assert left_out == 0.0 if is_fine else 0.01 < left_out < 0.3


def test_a_cloud_has_none() -> None:
    pairs = find_correspondences(
        prepare_scan(PointCloud(np.random.default_rng(4).normal(size=(100, 3)))), MeshSurface(PART), np.eye(4)
    )
    weights = np.ones(100)
    assert without_creases(Correspondences(pairs.scan, np.eye(4), pairs.closest, False), weights, 1.0) is weights


def test_the_information_of_the_points_is_that_of_rows_that_are_kept() -> None:
    rng = np.random.default_rng(5)
    pairs, weights = pairs_of(sample_mesh(PART, 9_000, rng).points), rng.uniform(0.0, 1.0, 9_000)
    surface = pairs.surface
    assert isinstance(surface, MeshSurface)
    near, sums = _near(pairs, surface, weights, 0.05)
    rows = plane_rows(pairs.moved, pairs.closest.normals, surface.centre, 0.5 * surface.diagonal)
    for found, some in zip(sums, (near, ~near), strict=True):
        assert found[0] == pytest.approx(weights[some].sum(), rel=1e-12)
        kept = (rows * weights)[:, some] @ rows[:, some].T
        np.testing.assert_allclose(squared(found[1:]), kept, rtol=0, atol=1e-12 * np.trace(kept))


def test_a_motion_is_held_by_some_points_where_they_tell_more_than_a_share_of_it() -> None:
    # Whatever the units of the motions, and where nothing holds one of them.
    rng = np.random.default_rng(6)
    mix = rng.normal(size=(6, 6)) * [1e3, 1e3, 1e3, 1.0, 1.0, 1.0]
    for shares, holds in (([0.45] * 5, False), ([0.05, 0.05, 0.55, 0.0, 0.0], True)):
        own, whole = (mix @ np.diag([*values, 0.0]) @ mix.T for values in (shares, [1.0] * 5))
        assert _constrain(own, whole - own) == holds
