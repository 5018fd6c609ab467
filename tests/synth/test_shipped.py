"""What lies in datasets_synth: recipes for every part, small cases that come out of their recipes, one picture."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dqreg.files import read_cloud, read_mesh
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.rigid import pose
from dqreg.synth import load_case, parts, read_recipe, write_case
from dqreg.synth.motion import moved_each, poses_at

HERE = Path(__file__).parents[2] / "datasets_synth"
SHIPPED = sorted(path.parent for path in HERE.glob("*/recipe.toml"))
RECIPES = sorted((HERE / "recipes").glob("*.toml"))


def column(scan: Path, name: str) -> np.ndarray:
    """One property of the shipped PLY files by a reader of our own."""
    header, _, body = scan.read_bytes().partition(b"end_header\n")
    types = {b"float": "<f4", b"double": "<f8"}
    lines = [line.split() for line in header.splitlines() if line.startswith(b"property")]
    table = np.frombuffer(body, dtype=[(field.decode(), types[kind]) for _, kind, field in lines])
    return table[name].astype(float)


def small(path: Path) -> str:
    """The recipe with fewer rays, so that all of them can be run."""
    text = path.read_text()
    for key in ("pixels", "rings", "azimuths"):
        text = "\n".join(f"{key} = 40" if line.startswith(f"{key} =") else line for line in text.splitlines())
    return text


def test_every_part_has_a_recipe():
    kinds = {read_recipe(path).part["kind"] for path in [*RECIPES, *(s / "recipe.toml" for s in SHIPPED)]}
    assert kinds == set(parts.KINDS)


def test_every_scanner_scene_and_motion_is_shown():
    recipes = [read_recipe(path) for path in [*RECIPES, *(s / "recipe.toml" for s in SHIPPED)]]
    assert {r.scanner_kind for r in recipes} == {"camera", "structured_light", "lidar", "tactile"}
    assert {r.scene.kind for r in recipes} == {"none", "table", "bin"}
    assert any(r.motion for r in recipes)
    for key in ("range_sigma", "grazing_growth", "dropout", "outlier_share", "mixed_share", "lateral_sigma",
                "quantisation"):  # fmt: skip
        assert any(getattr(r.noise, key) for r in recipes), key


def test_names_are_those_of_the_files():
    for path in RECIPES:
        assert read_recipe(path).name == path.stem
    for folder in SHIPPED:
        assert load_case(folder).truth["name"] == folder.name == read_recipe(folder / "recipe.toml").name


@pytest.mark.parametrize("path", RECIPES, ids=lambda p: p.stem)
def test_a_recipe_makes_a_case_that_its_truth_describes(path, tmp_path):
    (tmp_path / "recipe.toml").write_text(small(path))
    check(write_case(tmp_path / "case", tmp_path / "recipe.toml"))


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda p: p.name)
def test_a_shipped_case_is_what_its_truth_says(folder):
    check(load_case(folder))


def check(case) -> None:
    """The true pose puts the stated number of points on the part, to the stated noise."""
    truth = case.truth
    points = read_cloud(case.scan).points
    assert len(points) == truth["points"]
    if truth["motion"]:
        since = truth["motion"]["reference_time"] - column(case.scan, "time")
        points = moved_each(poses_at(np.array(truth["motion"]["twist"]), since), points)
    mesh = read_mesh(case.part)
    assert len(mesh.faces) == truth["faces"]
    every = slice(None, None, max(1, len(points) // 1500))
    surface = MeshSurface(Mesh(mesh.vertices, mesh.faces))
    for T in case.symmetric_truths[:: max(1, len(case.symmetric_truths) // 3)]:
        off = surface.closest(pose.apply(T, points[every])).distances
        noise = truth["noise"]
        grazing = 1 + noise["grazing_growth"] * (1 / np.cos(np.deg2rad(noise["max_incidence_deg"])) - 1)
        lateral = noise["lateral_sigma"] * 0.02 * case.part_diagonal
        tolerance = 5 * (case.range_sigma * grazing + lateral) + noise["quantisation"] + 1e-5 * case.part_diagonal
        # Faults lie off the part by what the truth says of them.
        for fault in truth.get("faults", []):
            turned = np.linalg.norm(np.deg2rad(fault.get("rotation_deg", 0.0))) * case.part_diagonal
            off_by = abs(fault.get("larger", 0.0)) + np.linalg.norm(fault.get("shift", 0.0)) + turned
            tolerance = max(tolerance, off_by + fault.get("amplitude", 0.0))
        share, count = truth["part_points"] / truth["points"], len(off)
        # Strays and clutter may lie on the part by chance, so the share can only be exceeded.
        assert (off < tolerance).mean() > share - 5 * np.sqrt(share * (1 - share) / count) - 1e-3


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda p: p.name)
def test_a_shipped_case_comes_out_of_its_recipe(folder, tmp_path):
    made = write_case(tmp_path / "case", folder / "recipe.toml")
    for name in ("recipe.toml", "part.stl"):
        ours, theirs = ((f / name).read_bytes() for f in (made.folder, folder))
        assert ours == theirs or name == "part.stl"
    # Another machine may round a sine or a hit at an edge differently; more than that it may not.
    np.testing.assert_allclose(made.T_target_source, load_case(folder).T_target_source, atol=1e-9)
    assert abs(made.truth["points"] - load_case(folder).truth["points"]) <= 20
    assert set(made.truth) == set(load_case(folder).truth)


def test_scenes_are_mostly_not_the_part():
    truth = load_case(HERE / "feeder_table").truth
    assert 0.05 < truth["part_points"] / truth["points"] < 0.5


def test_tactile_points_carry_exact_normals(tmp_path):
    case = write_case(tmp_path / "case", HERE / "angle_tactile" / "recipe.toml")
    cloud = read_cloud(case.scan)
    normals = pose.rotate(case.T_target_source, cloud.normals)
    mesh = read_mesh(case.part)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    _, _, face = trimesh.proximity.closest_point_naive(solid, pose.apply(case.T_target_source, cloud.points))
    np.testing.assert_allclose(normals, solid.face_normals[face], atol=1e-6)
    assert case.truth["scanner"]["compensated"] is True
    assert case.truth["scanner"]["probe_radius"] == 1.0


def test_the_folder_is_small():
    sizes = {
        path: path.stat().st_size for path in HERE.rglob("*") if path.is_file() and "__pycache__" not in path.parts
    }
    assert sum(sizes.values()) < 1_500_000
    for folder in SHIPPED:
        if folder.name != "bracket":
            assert sum(size for path, size in sizes.items() if path.parent == folder) < 200_000
    assert sizes[HERE / "cases.png"] < 1_000_000


def test_the_readme_names_every_case_recipe_and_key():
    text = (HERE / "README.md").read_text()
    assert "cases.png" in text
    for path in [*RECIPES, *SHIPPED]:
        assert f"`{path.stem}`" in text, path
    for key in load_case(HERE / "gear_motion").truth:
        assert f"`{key}`" in text, key
    for kind in parts.KINDS:
        assert f'"{kind}"' in text, kind


def test_same_bytes_whatever_the_thread_count(tmp_path):
    # Fresh processes; a scene, lateral noise and a motion, so that every generator and every room takes part.
    recipe = tmp_path / "recipe.toml"
    recipe.write_text(
        (HERE / "recipes" / "bracket_bin.toml").read_text().replace("pixels = 320", "pixels = 120")
        + '[motion]\nturn_deg = [1, 2, 3]\nshift = [0.1, 0, 0]\n'
    )  # fmt: skip
    code = "import sys; from dqreg.synth import write_case; write_case(sys.argv[2], sys.argv[1])"
    for name, threads in (("one", "1"), ("four", "4")):
        settings = {"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads, "MKL_NUM_THREADS": threads}
        environment = {**os.environ, **settings, "PYTHONPATH": os.pathsep.join(sys.path)}
        subprocess.run([sys.executable, "-c", code, recipe, tmp_path / name], check=True, env=environment)
    one, four = ({p.name: p.read_bytes() for p in (tmp_path / n).iterdir()} for n in ("one", "four"))
    assert one == four
    assert json.loads(one["truth.json"])["points"] > 5_000
