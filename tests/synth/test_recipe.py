from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.synth.parts import plate
from dqreg.synth.recipe import parse_recipe, read_recipe

GOOD = """
name = "thin"   # a comment
seed = 11
units = "m"

[part]
kind = "plate"
size = [0.1, 0.06, 0.004]
large_hole = 0.02
small_hole = 0.01

[scanner]
views = [[0, 0, 1], [1, 1, 1.5]]
pixels = 30
field_of_view_deg = 30

[noise]
range_sigma = 1e-5
max_incidence_deg = 60

[start]
angle_deg = 90
"""


def test_every_key_arrives():
    recipe = parse_recipe(GOOD)
    assert (recipe.name, recipe.seed, recipe.units) == ("thin", 11, "m")
    assert recipe.scanner.pixels == 30
    assert recipe.scanner.opening_rad == pytest.approx(np.pi / 6)
    assert recipe.noise.range_sigma == 1e-5
    assert recipe.noise.max_incidence_rad == pytest.approx(np.pi / 3)
    assert recipe.start_angle_rad == pytest.approx(np.pi / 2)
    vertices, faces = recipe.mesh()
    expected = plate(size=(0.1, 0.06, 0.004), large_hole=0.02, small_hole=0.01)
    np.testing.assert_allclose(vertices, expected[0], rtol=1e-7)
    np.testing.assert_array_equal(faces, expected[1])
    assert np.array_equal(vertices, vertices.astype(np.float32))


def test_defaults_are_documented_ones():
    recipe = parse_recipe('seed = 0\n[part]\nkind = "box"\n[scanner]\nviews = [[0, 0, 1]]\n')
    assert (recipe.name, recipe.units, recipe.coordinates) == ("case", "mm", "float64")
    assert (recipe.frame_offset, recipe.start_offset) == (0.5, 0.05)
    assert recipe.start_angle_rad == pytest.approx(np.deg2rad(20))
    assert recipe.noise.range_sigma == 0.0


def test_another_seed_also_stands_in_the_text():
    changed = parse_recipe(GOOD).with_seed(99)
    assert changed.seed == 99
    assert parse_recipe(changed.text).seed == 99
    assert changed.text.replace("seed = 99", "seed = 11") == GOOD


@pytest.mark.parametrize("seed", [-1, 1.5, True, "7"])
def test_a_seed_is_a_whole_number(seed):
    with pytest.raises(InputError, match="seed"):
        parse_recipe(GOOD).with_seed(seed)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("seed = 11", "", "seed.*missing"),
        ("seed = 11", "seed = -1", "seed"),
        ("seed = 11", "sead = 11", r"sead is not known; did you mean seed\?"),
        ('units = "m"', 'units = "parsec"', "units must be one of mm, cm, m, in"),
        ('units = "m"', 'coordinates = "float16"', "coordinates"),
        ('units = "m"', "noise = 3", r"noise must be a table|TOML"),
        ('kind = "plate"', 'kind = "plait"', "part.kind"),
        ('kind = "plate"', "", "part.kind is missing"),
        ('kind = "plate"', 'file = "a.stl"', "part.kind|part.size is not known"),
        ("large_hole = 0.02", "large_whole = 0.02", "part.large_whole.*part.large_hole"),
        ("large_hole = 0.02", "large_hole = -0.02", "part.large_hole"),
        ("large_hole = 0.02", "large_hole = 0.2", "part: a round of diameter 0.2"),
        ("size = [0.1, 0.06, 0.004]", "size = [0.1, 0.06]", "part.size"),
        ("views = [[0, 0, 1], [1, 1, 1.5]]", "", "scanner.views is missing"),
        ("views = [[0, 0, 1], [1, 1, 1.5]]", "views = [[0, 0]]", "scanner.views"),
        ("views = [[0, 0, 1], [1, 1, 1.5]]", "views = [[0, 0, 1], [1]]", "scanner.views"),
        ("views = [[0, 0, 1], [1, 1, 1.5]]", "views = 3", "scanner.views"),
        ("pixels = 30", "pixels = 0", "scanner.pixels"),
        ("pixels = 30", "pixel = 30", "scanner.pixel is not known; did you mean scanner.pixels"),
        ("pixels = 30", 'stand_off = "far"', "scanner.stand_off"),
        ("field_of_view_deg = 30", "field_of_view_deg = 200", "scanner.field_of_view_deg"),
        ("field_of_view_deg = 30", 'field_of_view_deg = "wide"', "scanner.field_of_view_deg"),
        ("field_of_view_deg = 30", "field_of_view_rad = 0.5", "scanner.field_of_view_rad is not known"),
        ("range_sigma = 1e-5", "range_sigma = -1", "noise.range_sigma"),
        ("range_sigma = 1e-5", "outlier_share = 2", "noise.outlier_share"),
        ("max_incidence_deg = 60", "max_incidence_deg = 95", "noise.max_incidence_deg"),
        ("angle_deg = 90", "angle = 90", "start.angle is not known"),
        ("angle_deg = 90", "angle_deg = nan", "start.angle_deg"),
        ("[start]", "[strat]", "strat is not known; did you mean start"),
        ("[start]", "[start", "not TOML"),
    ],
)
def test_a_bad_recipe_is_refused_by_key(old, new, words):
    assert old in GOOD
    with pytest.raises(InputError, match=words):
        parse_recipe(GOOD.replace(old, new)).mesh()


def test_a_recipe_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.toml"):
        read_recipe(tmp_path / "nothing.toml")


def test_a_part_that_is_not_there_or_no_mesh_is_named(tmp_path):
    text = 'seed = 1\n[part]\nfile = "p.stl"\n[scanner]\nviews = [[0, 0, 1]]\n'
    with pytest.raises(InputError, match=r"part\.file.*p\.stl"):
        parse_recipe(text, tmp_path).mesh()
    (tmp_path / "p.stl").write_bytes(b"not a mesh")
    with pytest.raises(InputError, match=r"part\.file.*p\.stl"):
        parse_recipe(text, tmp_path).mesh()
