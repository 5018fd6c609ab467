from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.synth import cases
from dqreg.synth.cases import Case, demo_case, load_case, write_case
from dqreg.synth.recipe import parse_recipe, read_recipe
from dqreg.synth.truth import worst_vertex_displacement

TEXT = """
seed = 3
coordinates = "float64"
[part]
kind = "bracket"
segments = 16
[scanner]
views = [[1, -1, 1], [-1, 1, 1]]
pixels = 30
[frame]
offset = 2.0
[start]
angle_deg = 20
offset = 0.05
"""
NAMES = ["part.stl", "recipe.toml", "scan.ply", "truth.json"]


def read_points(case: Case) -> np.ndarray:
    """The scan by a small reader of our own: trimesh would round float64 coordinates."""
    header, _, body = case.scan.read_bytes().partition(b"end_header\n")
    kind = "<f8" if b"property double x" in header else "<f4"
    return np.frombuffer(body, dtype=kind).reshape(-1, 3).astype(float)


def distances_to_part(case: Case, T: np.ndarray) -> np.ndarray:
    mesh = trimesh.load_mesh(case.part)
    points = pose.apply(T, read_points(case))
    return trimesh.proximity.closest_point_naive(mesh, points)[1]


def all_bytes(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir())}


def test_a_case_goes_round(tmp_path):
    written = write_case(tmp_path / "new" / "case", parse_recipe(TEXT))
    assert sorted(all_bytes(written.folder)) == NAMES
    loaded = load_case(tmp_path / "new" / "case")
    np.testing.assert_array_equal(loaded.T_target_source, written.T_target_source)
    np.testing.assert_array_equal(loaded.T_start, written.T_start)
    assert loaded.truth == written.truth
    assert (loaded.units, loaded.seed, loaded.range_sigma) == ("mm", 3, 0.0)
    assert loaded.recipe.read_text() == TEXT
    assert list((tmp_path / "new").iterdir()) == [tmp_path / "new" / "case"]  # no temporary folder stays


def test_the_truth_puts_a_noise_free_scan_on_the_part(tmp_path):
    case = write_case(tmp_path / "case", parse_recipe(TEXT))
    assert len(read_points(case)) == case.truth["points"]
    # Two changes of frame in float64; the scan's frame lies up to 400 mm from the part.
    assert distances_to_part(case, case.T_target_source).max() < 1e-12 * 400


def test_the_start_is_off_by_what_the_recipe_says(tmp_path):
    case = write_case(tmp_path / "case", parse_recipe(TEXT))
    step = case.T_start @ pose.inverse(case.T_target_source)
    assert np.rad2deg(pose.angle_between(case.T_start, case.T_target_source)) == pytest.approx(20.0, abs=1e-9)
    vertices = np.asarray(trimesh.load_mesh(case.part).vertices)
    centre = 0.5 * (vertices.max(axis=0) + vertices.min(axis=0))
    shift = np.linalg.norm(pose.apply(step, centre) - centre)
    assert shift == pytest.approx(0.05 * case.part_diagonal, rel=1e-9)
    assert worst_vertex_displacement(step, np.eye(4), vertices) > shift


def test_sensors_are_given_in_the_frame_of_the_scan(tmp_path):
    case = write_case(tmp_path / "case", parse_recipe(TEXT))
    sensors = pose.apply(case.T_target_source, case.truth["sensor_positions"])
    np.testing.assert_allclose(np.linalg.norm(sensors - [60.0, 40.0, 30.0], axis=1), 1.5 * case.part_diagonal)


def test_same_recipe_same_bytes_and_the_seed_counts(tmp_path):
    one = write_case(tmp_path / "one", parse_recipe(TEXT))
    two = write_case(tmp_path / "two", parse_recipe(TEXT))
    other = write_case(tmp_path / "other", parse_recipe(TEXT), seed=4)
    assert all_bytes(one.folder) == all_bytes(two.folder)
    assert other.seed == 4
    assert not np.allclose(other.T_target_source, one.T_target_source)
    again = write_case(tmp_path / "again", other.recipe)
    assert all_bytes(again.folder) == all_bytes(other.folder)


def test_float32_costs_one_rounding(tmp_path):
    fine = write_case(tmp_path / "fine", parse_recipe(TEXT))
    coarse = write_case(tmp_path / "coarse", parse_recipe(TEXT.replace("float64", "float32")))
    np.testing.assert_array_equal(read_points(coarse), read_points(fine).astype(np.float32))


def test_a_case_of_a_mesh_file_makes_itself_again(tmp_path):
    part = write_case(tmp_path / "first", parse_recipe(TEXT)).part
    recipe = tmp_path / "mine.toml"
    text = 'seed = 5\n[part]\nfile = "first/part.stl"\n[scanner]\nviews = [[1, 1, 1]]\npixels = 25\n'
    recipe.write_text(text)
    case = write_case(tmp_path / "second", recipe)
    assert distances_to_part(case, case.T_target_source).max() < 1e-12 * 400
    assert case.part.read_bytes()[84:] == part.read_bytes()[84:]
    part.unlink()
    again = write_case(tmp_path / "third", case.recipe)
    assert all_bytes(again.folder) == all_bytes(case.folder)


def test_an_older_case_is_replaced_and_other_things_are_left_alone(tmp_path):
    folder = tmp_path / "case"
    write_case(folder, parse_recipe(TEXT))
    assert write_case(folder, folder / "recipe.toml", seed=8).seed == 8
    (folder / "notes.txt").write_text("mine")
    before = all_bytes(folder)
    with pytest.raises(InputError, match=r"notes\.txt"):
        write_case(folder, parse_recipe(TEXT))
    with pytest.raises(InputError, match="it is a file"):
        write_case(folder / "notes.txt", parse_recipe(TEXT))
    assert all_bytes(folder) == before
    assert list(tmp_path.iterdir()) == [folder]


def test_a_failure_leaves_the_old_case_whole(tmp_path, monkeypatch):
    folder = tmp_path / "case"
    write_case(folder, parse_recipe(TEXT))
    before = all_bytes(folder)

    def fail(self, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(InputError, match="No space left"):
        write_case(folder, parse_recipe(TEXT), seed=9)
    assert all_bytes(folder) == before
    assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.parametrize("name", ["scan.ply", "part.stl", "truth.json"])
def test_a_missing_file_is_named(tmp_path, name):
    case = write_case(tmp_path / "case", parse_recipe(TEXT))
    (case.folder / name).unlink()
    with pytest.raises(InputError, match=name):
        load_case(case.folder)


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("T_target_source", None, "T_target_source"),
        ("T_start", [[1, 0], [0, 1]], "T_start"),
        ("seed", "many", "many"),
        ("units", ..., "units"),
        ("part_diagonal", ..., "part_diagonal"),
    ],
)
def test_a_wrong_truth_is_named(tmp_path, key, value, word):
    case = write_case(tmp_path / "case", parse_recipe(TEXT))
    truth = dict(case.truth)
    if value is ...:
        del truth[key]
    else:
        truth[key] = value
    (case.folder / "truth.json").write_text(json.dumps(truth))
    with pytest.raises(InputError, match=word):
        load_case(case.folder)


def test_the_shipped_case_comes_out_of_its_recipe(tmp_path):
    shipped = load_case(demo_case())
    made = write_case(tmp_path / "bracket", shipped.recipe)
    if all_bytes(made.folder) == all_bytes(shipped.folder):
        return
    # Another machine may round a sine or a hit at an edge differently; more than that it may not.
    assert made.recipe.read_bytes() == shipped.recipe.read_bytes()
    np.testing.assert_allclose(made.T_target_source, shipped.T_target_source, atol=1e-9)
    np.testing.assert_allclose(made.T_start, shipped.T_start, atol=1e-9)
    here, there = (trimesh.load_mesh(c.part).triangles for c in (made, shipped))
    np.testing.assert_allclose(here, there, atol=2e-5)
    assert abs(made.truth["points"] - shipped.truth["points"]) < 20
    rounded = [{tuple(p) for p in read_points(c).round(3)} for c in (made, shipped)]
    assert len(rounded[0] & rounded[1]) > 0.95 * shipped.truth["points"]


def test_the_shipped_case_is_what_its_truth_says():
    case = load_case(demo_case())
    points = read_points(case)
    assert len(points) == case.truth["points"]
    assert 0.55 <= case.truth["surface_seen"] <= 0.65
    assert sum(p.stat().st_size for p in case.folder.iterdir()) < 2_000_000
    every = slice(None, None, 60)
    mesh = trimesh.load_mesh(case.part)
    moved = pose.apply(case.T_target_source, points[every])
    distance = trimesh.proximity.closest_point_naive(mesh, moved)[1]
    # All but the 2 % outliers lie within five sigma; seen at an angle, their spread is below the range noise.
    good = distance < 5 * case.range_sigma
    assert good.mean() > 0.96
    assert 0.5 * case.range_sigma < np.sqrt((distance[good] ** 2).mean()) < case.range_sigma
    assert read_recipe(case.recipe).seed == case.seed


def test_no_shipped_case_is_a_named_error(monkeypatch, tmp_path):
    monkeypatch.setattr(cases, "__file__", str(tmp_path / "a" / "b" / "cases.py"))
    with pytest.raises(InputError, match="demonstration case is missing"):
        demo_case()


def test_the_installed_place_comes_first(monkeypatch, tmp_path):
    installed, checkout = tmp_path / "dqreg" / "synth" / "bracket", tmp_path / "datasets_synth" / "bracket"
    monkeypatch.setattr(cases, "__file__", str(installed.parent / "cases.py"))
    for place in (checkout, installed):
        place.mkdir(parents=True)
        (place / "truth.json").write_text("{}")
        assert demo_case() == place.resolve()


def test_a_relative_folder_and_a_link_are_followed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "goal").mkdir()
    (tmp_path / "link").symlink_to("goal")
    write_case("link", parse_recipe(TEXT))
    write_case("link", parse_recipe(TEXT))
    assert sorted(all_bytes(tmp_path / "goal")) == NAMES
    assert sorted(p.name for p in tmp_path.iterdir()) == ["goal", "link"]
    assert (tmp_path / "link").is_symlink()
