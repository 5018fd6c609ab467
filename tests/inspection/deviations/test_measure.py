from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg._open3d import load_open3d
from dqreg.errors import InputError
from dqreg.files import read_cloud
from dqreg.geometry import CloudSurface, Mesh, MeshSurface, PointCloud
from dqreg.inspection import Deviations, measure_deviations
from dqreg.inspection.deviations import signed_distances
from dqreg.inspection.deviations.files import RGB_STOPS, colours_of
from dqreg.synth.parts import box, bracket
from tests.trust import shapes


def measured(points: Any, mesh: Mesh, **options: Any) -> Deviations:
    return measure_deviations(np.asarray(points, dtype=float), mesh, MeshSurface(mesh), **options)


def test_deviations_of_a_box_are_those_of_its_formula() -> None:
    half = np.array([1.5, 1.0, 0.5])
    mesh = Mesh(*box(tuple(2 * half)))
    mesh = Mesh(mesh.vertices - mesh.centre, mesh.faces)
    points = np.random.default_rng(0).uniform(-2.0, 2.0, size=(5000, 3))
    beyond = np.abs(points) - half
    expected = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    found = measured(points, mesh)
    assert found.signed
    np.testing.assert_allclose(found.values, expected, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(found.points - found.closest, axis=1), np.abs(found.values), atol=1e-14)
    corners = mesh.corners[found.faces]
    heights = np.einsum("ni,ni->n", found.closest - corners[:, 0], mesh.face_normals[found.faces])
    np.testing.assert_allclose(heights, 0.0, atol=1e-14)


@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
def test_deviations_of_round_parts_are_those_of_their_formula_up_to_the_facets(shape: str) -> None:
    import trimesh

    made = (
        trimesh.creation.icosphere(subdivisions=4)
        if shape == "sphere"
        else trimesh.creation.cylinder(1.0, 4.0, sections=256)
    )
    mesh = Mesh(made.vertices, made.faces)
    points = np.random.default_rng(1).normal(size=(3000, 3))
    points[:, 2] = np.clip(points[:, 2], -0.8, 0.8) if shape == "cylinder" else points[:, 2]
    radius = np.linalg.norm(points[:, : 2 if shape == "cylinder" else 3], axis=1)
    rows = radius > 0.3
    # The facets lie inside the circle: by 1 - cos(half a facet's angle) at most.
    sag = 1.0 - np.cos(np.pi / 256) if shape == "cylinder" else 2.5e-3
    gaps = measured(points[rows], mesh).values - (radius[rows] - 1.0)
    assert gaps.min() >= -1e-12
    assert gaps.max() <= sag


def test_chunks_are_the_whole_in_the_order_of_the_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = Mesh(*bracket())
    rng = np.random.default_rng(2)
    points = rng.uniform(*(mesh.bounds + np.array([[-5.0], [5.0]])), size=(1000, 3))
    points[500:] = points[rng.integers(500, size=500)]  # duplicates keep their rows and their values
    whole, told = measured(points, mesh), []
    monkeypatch.setattr(signed_distances, "CHUNK_POINTS", 16)
    monkeypatch.setattr(signed_distances, "PROGRESS_POINTS", 64)
    parts = measured(points, mesh, progress=lambda done, total: told.append((done, total)))
    for name in ("values", "points", "closest", "faces"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    assert told[-1] == (1000, 1000)
    assert len(told) == 16
    one_by_one = [measured(points[k : k + 1], mesh, spacing=1.0).values[0] for k in range(0, 1000, 100)]
    np.testing.assert_array_equal(whole.values[::100], one_by_one)
    np.testing.assert_array_equal(whole.points, points)


def test_without_a_copy_the_points_become_those_of_the_record() -> None:
    mesh, origin = Mesh(*box((3.0, 2.0, 1.0))), np.array([5.0, -3.0, 1.0])
    points = np.random.default_rng(3).uniform(-1.0, 4.0, size=(500, 3))
    given = points.copy()
    kept, taken = measured(given, mesh, origin=origin), measured(points, mesh, origin=origin, copy=False)
    assert taken.points is points
    for name in ("values", "points", "closest", "flags"):
        np.testing.assert_array_equal(getattr(taken, name), getattr(kept, name))


def test_a_far_origin_costs_no_digits() -> None:
    mesh = Mesh(*box((3.0, 2.0, 1.0)))
    points = np.random.default_rng(3).uniform(-1.0, 4.0, size=(500, 3))
    near, far = (measured(points, mesh, origin=origin) for origin in (None, np.array([5e6, -3e6, 1e5])))
    np.testing.assert_array_equal(far.values, near.values)
    np.testing.assert_array_equal(far.points, points + np.array([5e6, -3e6, 1e5]))
    places = [place.value for place in near.worst(5)]
    assert [place.value for place in far.worst(5)] == places


@pytest.mark.parametrize(
    ("faces", "words"),
    [
        (lambda f: f[1:], "not watertight"),
        (lambda f: np.vstack([f[:1, ::-1], f[1:]]), "flipped faces"),
    ],
)
def test_without_an_inside_deviations_have_no_sign_and_say_why(faces: Any, words: str) -> None:
    vertices, all_faces = box((2.0, 2.0, 2.0))
    mesh = Mesh(vertices, faces(all_faces))
    found = measured(mesh.centre + np.random.default_rng(4).normal(size=(200, 3)), mesh)
    assert not found.signed
    assert words in found.reason
    assert found.values.min() >= 0.0


def test_a_mesh_that_is_wound_inward_is_turned() -> None:
    vertices, faces = bracket()
    points = Mesh(vertices, faces).centre + np.random.default_rng(5).normal(scale=30.0, size=(300, 3))
    right, inward = (measured(points, Mesh(vertices, f)) for f in (faces, faces[:, ::-1]))
    assert "exchanged" in inward.reason
    np.testing.assert_allclose(inward.values, right.values, atol=1e-12)


@pytest.mark.parametrize("given", [True, False])
def test_the_gaps_between_the_points_of_a_cloud_count_for_nothing(given: bool) -> None:
    rng = np.random.default_rng(6)
    points, normals = shapes.plane(rng, 4000)
    cloud = PointCloud(points, normals if given else None)
    queries = np.column_stack([rng.uniform(-0.9, 0.9, (500, 2)), rng.normal(scale=1e-3, size=500)])
    found = measure_deviations(queries, cloud, CloudSurface(cloud))
    assert found.signed == given
    expected = queries[:, 2] if given else np.abs(queries[:, 2])
    # Where a gap is wider than the discs (3 spacings) the distance to their rim counts: few points, and no less.
    exact = np.abs(found.values - expected) <= 1e-12
    assert exact.mean() > 0.95
    assert (np.abs(found.values) >= np.abs(expected) - 1e-12).all()


def test_figures_and_bands_of_known_values() -> None:
    values = np.array([-0.3, -0.06, -0.05, -0.02, 0.0, 0.025, 0.05, 0.051, 7.0])
    record = Deviations(
        values, np.zeros((9, 3)), np.zeros((9, 3)), np.zeros(9, dtype=int), True, "", "mm", tolerance=0.05, reach=1.0
    )
    summary = record.summary()
    assert (summary.count, summary.beyond, summary.max) == (8, 1, 0.3)
    assert summary.mean == pytest.approx(values[:8].mean())
    assert summary.rms == pytest.approx(np.sqrt(np.mean(values[:8] ** 2)))
    assert [summary.p50, summary.p95, summary.p99] == pytest.approx(np.quantile(np.abs(values[:8]), [0.5, 0.95, 0.99]))
    assert summary.share_within == pytest.approx(5 / 8)
    bands = record.bands(required_share=0.625)
    assert [row.count for row in bands.rows] == [2, 1, 3, 1, 1]
    assert (bands.passed, record.bands(required_share=0.63).passed, record.bands(0.06).passed) == (True, False, False)
    assert sum(row.share for row in bands.rows) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda d: d.bands(), "bands need a tolerance"),
        (lambda d: d.bands(-1.0), "tolerance must be a length above 0"),
        (lambda d: d.summary("0.1"), "tolerance must be a length above 0"),
        (lambda d: d.bands(1.0, required_share=1.5), "required_share"),
        (lambda d: d.worst(3, apart=0.0), "apart"),
        (lambda d: d.save("dev.stl"), "written as .ply, .csv, .npy"),
        (lambda d: d.save("no/folder/dev.ply"), "does not exist"),
        (lambda d: d.save("dev.ply", limit=np.nan), "limit"),
    ],
)
def test_what_cannot_be_used_is_refused_in_words(call: Any, words: str, monkeypatch: Any, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    record = measured(np.eye(3), Mesh(*box((1.0, 1.0, 1.0))))
    with pytest.raises(InputError, match=words):
        call(record)
    assert list(tmp_path.iterdir()) == []


def dented() -> tuple[Deviations, np.ndarray]:
    """A plate with a dent of 0.3 about one corner, a bump of 0.2, noise, and a stray in two hundred."""
    rng = np.random.default_rng(7)
    mesh = Mesh(*box((100.0, 60.0, 5.0)))
    points = np.column_stack([rng.uniform(0, 100, 20_000), rng.uniform(0, 60, 20_000), rng.normal(5.0, 0.01, 20_000)])
    points[:, :2] += mesh.bounds[0, :2]
    points[:, 2] += mesh.bounds[1, 2] - 5.0
    centres = mesh.bounds[0] + np.array([[20.0, 20, 5], [80, 40, 5]])
    points[np.linalg.norm(points[:, :2] - centres[0, :2], axis=1) < 3.0, 2] -= 0.3
    points[np.linalg.norm(points[:, :2] - centres[1, :2], axis=1) < 3.0, 2] += 0.2
    points[rng.integers(20_000, size=100), 2] += rng.uniform(0.5, 4.0, size=100)
    return measured(points, mesh, tolerance=0.1, units="mm"), centres


def test_worst_places_are_the_defects_and_not_the_strays() -> None:
    record, centres = dented()
    assert np.abs(record.values).max() > 3.0
    dent, bump = record.worst(2)
    assert dent.value == pytest.approx(-0.3, abs=0.04)
    assert bump.value == pytest.approx(0.2, abs=0.04)
    for place, centre in zip((dent, bump), centres, strict=True):
        assert np.linalg.norm(place.position[:2] - centre[:2]) < 3.5
        # pi 3^2 of 6000 mm^2 at 20,000 points are 94.
        assert 60 <= place.points <= 130
        assert record.values[place.row] == place.value
        np.testing.assert_array_equal(record.points[place.row], place.position)
    places = record.worst(50)
    assert all(
        np.linalg.norm(a.position - b.position) >= 0.9 * record.apart for k, a in enumerate(places) for b in places[:k]
    )


def test_every_point_of_a_touch_probe_counts() -> None:
    mesh = Mesh(*box((10.0, 10.0, 10.0)))
    points = mesh.centre + np.array([[5.0, 0, 0], [0, 5.0, 0], [0, 0, 5.4], [-5, 0, 0], [0, -4.9, 0]])
    values = [place.value for place in measured(points, mesh).worst(2)]
    assert values == pytest.approx([0.4, -0.1])


def test_the_coloured_ply_is_read_by_open3d_and_by_us(tmp_path: Path) -> None:
    record, _ = dented()
    file = tmp_path / "dev.ply"
    record.save(file)
    cloud = load_open3d().t.io.read_point_cloud(str(file))
    np.testing.assert_array_equal(cloud.point.positions.numpy(), record.points)
    np.testing.assert_array_equal(cloud.point["deviation"].numpy().ravel(), record.values)
    np.testing.assert_array_equal(cloud.point.colors.numpy(), colours_of(record.values, 0.1))
    ours = read_cloud(file)
    np.testing.assert_array_equal(ours.points, record.points)
    assert ours.units == "mm"


@pytest.mark.parametrize("noise", [None, 0.03])
def test_arrays_hold_every_digit_and_tables_what_the_noise_deserves(tmp_path: Path, noise: float | None) -> None:
    record = dataclasses.replace(dented()[0], noise=noise)
    record.save(tmp_path / "dev.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "dev.npy"), record.values)
    record.save(tmp_path / "dev.csv")
    head, first, *_ = (tmp_path / "dev.csv").read_text().splitlines()
    assert head.startswith("x [mm],y [mm],z [mm],deviation [mm],closest_x [mm],")
    # Rounding to a fiftieth of the noise widens it by 2e-5; without noise, a hundred millionth of the part.
    step = 1e-8 * record.size if noise is None else 0.02 * noise
    assert len(first.split(",")[3].partition(".")[2]) == np.ceil(-np.log10(step))
    table = np.genfromtxt(tmp_path / "dev.csv", delimiter=",", skip_header=1)
    np.testing.assert_allclose(table[:, 3], record.values, rtol=0.0, atol=0.5 * step)
    np.testing.assert_allclose(table[:, :3], record.points, atol=0.5 * step)
    columns = dict(zip(head.split(","), table.T, strict=True))
    np.testing.assert_array_equal(columns["face"], record.faces)
    np.testing.assert_array_equal(columns["row"], np.arange(len(record)))
    np.testing.assert_array_equal(columns["flag"], record.flags)
    np.testing.assert_array_equal(columns["within"], np.abs(record.values) <= 0.1)
    normals = np.column_stack([columns[f"normal_{axis}"] for axis in "xyz"])
    np.testing.assert_allclose(normals, record.normals(np.arange(len(record))), atol=5e-5)


def test_the_colours_are_told_apart_without_red_or_green() -> None:
    # Vienot, Brettel and Mollon (1999), linear RGB: what a protanope and a deuteranope see.
    protan = np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]])
    deutan = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]])
    linear = (colours_of(np.linspace(-1.0, 1.0, 41), 1.0) / 255.0) ** 2.2
    for seen in (linear, linear @ protan.T, linear @ deutan.T):
        # Blue against yellow names the side, lightness the size.
        blueness = seen[:, 2] - 0.5 * (seen[:, 0] + seen[:, 1])
        lightness = seen @ [0.2126, 0.7152, 0.0722]
        assert (blueness[:18] > 0.02).all()
        assert (blueness[23:] < -0.02).all()
        assert (np.diff(lightness[:21]) > 0.0).all()
        assert (np.diff(lightness[20:]) < 0.0).all()
    assert len(RGB_STOPS) % 2 == 1
