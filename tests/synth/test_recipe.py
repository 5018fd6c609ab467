from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.synth.case_contents import case_contents
from dqreg.synth.parts import blade, plate
from dqreg.synth.patterns import Lidar
from dqreg.synth.recipe import parse_recipe, read_recipe
from dqreg.synth.scene import Scene
from dqreg.synth.tactile import TactileProbe

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
        ('units = "m"', 'units = "parsec"', "units must be one of um, mm, cm, m, inch, ft"),
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


FULL = """
seed = 5
[part]
kind = "blade"
twist_deg = 20
[scene]
kind = "bin"
clutter = 2
[scanner]
kind = "lidar"
views = [[1, 1, 1]]
rings = 20
azimuth_deg = 90
[noise]
lateral_sigma = 0.5
quantisation = 0.1
[motion]
turn_deg = [0, -90, 120]
shift = [0.1, 0, 0]
reference = 1
"""


def test_every_new_key_arrives():
    recipe = parse_recipe(FULL)
    assert recipe.scanner_kind == "lidar"
    assert recipe.scanner == Lidar(views=[[1, 1, 1]], rings=20, azimuth_rad=np.pi / 2)
    assert recipe.scene == Scene(kind="bin", clutter=2)
    assert (recipe.noise.lateral_sigma, recipe.noise.quantisation) == (0.5, 0.1)
    np.testing.assert_allclose(recipe.motion.turn_rad, [0, -np.pi / 2, np.pi / 1.5])
    assert recipe.motion.reference == 1
    np.testing.assert_allclose(recipe.mesh()[0], blade(twist_rad=np.deg2rad(20))[0], rtol=1e-6, atol=1e-6)
    assert len(recipe.symmetry().poses) == 1
    probe = parse_recipe('seed = 1\n[part]\nkind = "box"\n[scanner]\nkind = "tactile"\npoints = 12\n')
    assert probe.scanner == TactileProbe(points=12)
    assert probe.motion is None


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('kind = "lidar"', 'kind = "lidars"', "scanner.kind must be one of camera, structured_light, lidar, tactile"),
        ('kind = "lidar"', "kind = 7", "scanner.kind must be one of .*got 7"),
        ("rings = 20", "pixels = 20", "scanner.pixels is not known; known here: views, rings"),
        ("rings = 20", "rings = 1e2", "scanner.rings must be a whole number above 0; got 100.0"),
        ("rings = 20", "rings = 90000000", "scanner.rings is too large: 90000000 makes .* rays"),
        ("azimuth_deg = 90", "azimuth_deg = 400", "scanner.azimuth_deg must .* at most a full turn; got 400 degrees"),
        ("azimuth_deg = 90", "azimuth_deg = -90", "scanner.azimuth_deg must be a number that is not negative; got -90"),
        ("views = [[1, 1, 1]]", "views = [[0, 0, 1]]", "scanner.views holds one that looks along the axis"),
        ('kind = "bin"', 'kind = "box"', "scene.kind must be one of none, table, bin; got 'box'"),
        ('kind = "bin"', 'kind = "none"', "scene.clutter needs something to lie on"),
        ("clutter = 2", "cluter = 2", "scene.cluter is not known; did you mean scene.clutter"),
        ("clutter = 2", "size = 0", "scene.size must lie between 1 and 100 diagonals of the part; got 0"),
        ("lateral_sigma = 0.5", "lateral_sigma = true", "noise.lateral_sigma must be a number .*got True"),
        ("quantisation = 0.1", "quantisation = -1", "noise.quantisation"),
        ("turn_deg = [0, -90, 120]", "turn_deg = 4", "motion.turn_deg must be three numbers"),
        ("turn_deg = [0, -90, 120]", 'turn_deg = ["a", 0, 0]', r"motion.turn_deg must be a list of numbers; got \['a'"),
        (
            "turn_deg = [0, -90, 120]",
            "turn_deg = [0, 0, 1e6]",
            r"motion.turn_deg .* at most a half-turn; got \[0, 0, 1000000.0\] degrees",
        ),
        ("shift = [0.1, 0, 0]", "shift = [0.1, inf, 0]", "motion.shift must be three numbers"),
        ("reference = 1", "reference = 2", "motion.reference must be a number from 0 to 1; got 2"),
        ("twist_deg = 20", "twist_deg = 100", "part.twist_deg must lie between 0 and a right angle; got 100 degrees"),
        ("twist_deg = 20", 'chord = "long"', "part.chord must be a number above 0; got 'long'"),
        ("twist_deg = 20", "chord = 1e300", "part.chord"),
        ("twist_deg = 20", "stations = 9999999", "part.stations must be a whole number from 4 to 500; got 9999999"),
        ("seed = 5", 'seed = 5\nname = "../up"', r"name must be letters.*got '\.\./up'"),
        ("seed = 5", "seed = 5\nname = 3", "name must be letters.*got 3"),
        ("seed = 5", "seed = 1979-05-27", "seed must be a whole number"),
        ("[motion]", "[start]\nangle_deg = 1e9\n[motion]", "start.angle_deg must be at most 180; got 1000000000.0"),
        ("[motion]", "[start]\noffset = 1e99\n[motion]", "start.offset must be at most 1e.06"),
        ("[motion]", "[frame]\noffset = 1e99\n[motion]", "frame.offset must be at most"),
    ],
)
def test_a_bad_full_recipe_is_refused_by_key(old, new, words):
    assert old in FULL
    with pytest.raises(InputError, match=words):
        parse_recipe(FULL.replace(old, new)).mesh()


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ("[noise]\ndropout = 0.5", "noise.dropout = 0.5 means nothing for a tactile probe"),
        ("[scene]\nkind = 'bin'", "scene.kind = 'bin' means nothing for a tactile probe"),
        ("[motion]\nturn_deg = [0, 0, 1]", r"\[motion\] means nothing for a tactile probe"),
    ],
)
def test_what_a_probe_cannot_do_is_refused(extra, words):
    with pytest.raises(InputError, match=words):
        parse_recipe(f'seed = 1\n[part]\nkind = "box"\n[scanner]\nkind = "tactile"\n{extra}\n')


@pytest.mark.parametrize(
    ("part", "scanner", "extra", "words"),
    [
        (
            'kind = "box"',
            "views = [[1, 2, 3]]",
            "[noise]\nrange_sigma = 5",
            "noise.range_sigma must be at most a tenth",
        ),
        (
            'kind = "box"',
            "views = [[1, 2, 3]]",
            "[noise]\nquantisation = 5",
            "noise.quantisation must be at most a tenth",
        ),
        (
            'kind = "box"',
            "views = [[1, 2, 3]]",
            "[scene]\nkind = 'table'\nsize = 1.5\nclutter = 99",
            "scene.clutter is too",
        ),
        ('kind = "box"', 'kind = "tactile"\nprobe_radius = 9', "", "scanner.probe_radius must be at most a tenth"),
        ('kind = "box"', 'kind = "tactile"', "[noise]\nrange_sigma = 9", "noise.range_sigma must be at most a tenth"),
        ('kind = "box"', 'kind = "tactile"\nmax_tilt_deg = 1\nviews = [[1, 1, 1]]', "", "scanner.points is too large"),
        ('kind = "box"\nsize = [1e30, 1, 1]', "views = [[1, 2, 3]]", "", "part: its largest coordinate is 5e.29"),
        ('kind = "bracket"\nfillet_radius = 1e-7', "views = [[1, 2, 3]]", "", "part: its dimensions .* in float32"),
    ],
)
def test_what_does_not_fit_the_part_is_refused_by_key(part, scanner, extra, words):
    recipe = parse_recipe(f"seed = 1\n[part]\n{part}\n[scanner]\n{scanner}\n{extra}\n")
    with pytest.raises(InputError, match=words):
        case_contents(recipe)


def test_a_bad_recipe_file_is_named(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("[part")
    with pytest.raises(InputError, match=r"mine\.toml: the recipe is not TOML"):
        read_recipe(path)


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
