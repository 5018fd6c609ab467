"""Faults of a recipe: the shipped case has them, its plan finds them, and wrong entries are named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import read_cloud
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import fit_feature, inspect, measure_deviations, read_plan
from dqreg.rigid import pose
from dqreg.synth.case_contents import case_contents
from dqreg.synth.recipe import Recipe, parse_recipe, read_recipe

HERE = Path(__file__).parents[2] / "datasets_synth"
HEAD = 'seed = 1\n[part]\nkind = "box"\nsize = [30, 20, 10]\n[scanner]\nviews = [[0, 0, 1]]\npixels = 40\n'


Parts = tuple[np.ndarray, np.ndarray, dict[str, Any]]


def made(recipe: Recipe, folder: Path) -> Parts:
    """Vertices of the part, points in its frame, and the truth."""
    found = case_contents(recipe)
    truth = json.loads(found["truth.json"])
    (folder / "scan.ply").write_bytes(found["scan.ply"])
    points = read_cloud(folder / "scan.ply").points
    return recipe.mesh()[0], pose.apply(np.array(truth["T_target_source"]), points), truth


def contents(faults: str, folder: Path) -> tuple[np.ndarray, dict[str, Any]]:
    """Points of a box seen from above, and the truth."""
    return made(parse_recipe(f"{HEAD}{faults}"), folder)[1:]


def test_a_face_is_wavy_moved_and_turned_by_what_the_recipe_says(tmp_path: Path) -> None:
    points, truth = contents("[[form_error]]\nnear = [0, 0, 5]\namplitude = 0.2\nwaves = 3\n", tmp_path)
    # Ten points a wave: the crest itself lies up to half a point's distance beside one of them.
    assert 0.2 * np.cos(np.pi / 10) < np.ptp(points[:, 2]) <= 0.2 + 1e-12
    assert truth["faults"][0]["amplitude"] == 0.2
    moved, truth = contents(
        "[[moved_feature]]\nnear = [0, 0, 5]\nlarger = 0.25\nrotation_deg = [0, 0.5, 0]\n", tmp_path
    )
    plane = fit_feature(moved, "plane")
    assert np.degrees(np.arccos(abs(plane.axis[2]))) == pytest.approx(0.5, abs=1e-9)
    # 0.25 higher, then turned about where the middle of the face was.
    assert abs((plane.point - [0, 0, 5]) @ plane.axis) == pytest.approx(0.25, abs=1e-9)
    # The number that the truth gives is that of the entry.
    number = truth["faults"][0]["face"]
    again, _ = contents(f"[[moved_feature]]\nface = {number}\nlarger = 0.25\nrotation_deg = [0, 0.5, 0]\n", tmp_path)
    np.testing.assert_array_equal(moved, again)


def test_a_recipe_without_faults_has_no_word_of_them(tmp_path: Path) -> None:
    assert "faults" not in contents("", tmp_path)[1]


def test_the_plan_of_the_shipped_recipe_finds_its_faults(tmp_path: Path) -> None:
    recipe = read_recipe(HERE / "recipes" / "bracket_faults.toml")
    vertices, points, truth = made(recipe, tmp_path)
    part = Mesh(vertices, recipe.mesh()[1])
    scan = measure_deviations(points, part, MeshSurface(part), reach=2.0, noise=truth["range_sigma"])
    rows = {row.name: row for row in inspect(scan, read_plan(HERE / "plans" / "bracket_faults.toml")).characteristics}
    waves, lobes, thicker, hole, _ = truth["faults"]
    for name, expected in {
        "flatness of A": waves["amplitude"],
        "base thickness": 10.0 + thicker["larger"],
        "large hole": 16.0 + 2.0 * hole["larger"],
        "large hole position": 2.0 * hole["shift"][0],
        "small hole roundness": lobes["amplitude"],
        "top of the base": 2.0 * thicker["larger"],
        "edge of the base": thicker["larger"],
    }.items():
        assert abs(rows[name].value - expected) <= rows[name].uncertainty, name
    assert [name for name, row in rows.items() if row.outcome == "fail"] == [
        "large hole",
        "large hole position",
        "front to A",
    ]


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("[form_error]\nface = 1\n", r"form_error must be written as \[\[form_error\]\]"),
        ("[[form_error]]\nface = 1\n", "form_error 1.amplitude is missing"),
        ("[[form_error]]\namplitude = 1\n", "form_error 1 needs face = NUMBER"),
        ("[[form_error]]\nface = 1\nnear = [1, 2, 3]\namplitude = 1\n", "one of them"),
        ("[[form_error]]\nface = 1\namplitde = 1\n", "form_error 1.amplitde is not known.*did you mean"),
        ("[[form_error]]\nface = 1\namplitude = -1\n", "form_error 1.amplitude must be a number that is not negative"),
        ("[[form_error]]\nface = 1\namplitude = 1\nwaves = 1\n", "form_error 1.waves must be a whole number from 2 on"),
        ("[[form_error]]\nface = 99\namplitude = 1\n", "form_error 1.face is 99; the part's faces are 0 to 5"),
        ("[[moved_feature]]\nnear = [0, 0, -5]\n", "moved_feature 1: the scan has no points on those triangles"),
        ("[[moved_feature]]\nface = 0\nshift = 1\n", "moved_feature 1.shift must be 3 numbers; got 1"),
        ("[[moved_feature]]\nface = 0\nlarger = 'a'\n", "moved_feature 1.larger must be a number"),
        ("[motion]\nturn_deg = [1, 0, 0]\n[[moved_feature]]\nface = 0\n", "a part that moves meanwhile"),
    ],
)
def test_a_wrong_entry_is_named(entry: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"recipe: .*{words}" if "recipe" not in words else words):
        contents(entry, tmp_path)
