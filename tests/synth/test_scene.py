from __future__ import annotations

import numpy as np
import pytest
import trimesh

from dqreg.errors import InputError
from dqreg.synth.cameras import Scanner
from dqreg.synth.noise import Noise
from dqreg.synth.parts import bracket, feeder
from dqreg.synth.scanner import scan_mesh
from dqreg.synth.scene import Scene

SCENE = Scene(kind="table", clutter=6, size=3.0)
SCANNER = Scanner(views=((0.5, -0.6, 1.0),), pixels=100, stand_off=2.5, field_of_view_rad=0.8)


def bodies(mesh):
    return trimesh.Trimesh(*mesh, process=False).split(only_watertight=False)


def test_no_scene_is_nothing():
    assert Scene().surroundings(bracket()[0], np.random.default_rng(0)) is None


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 2.0, 3.0)])
@pytest.mark.parametrize("kind", ["table", "bin"])
def test_the_part_rests_on_the_floor_and_nothing_goes_through_anything(kind, up):
    vertices, _ = bracket()
    scene = Scene(kind=kind, clutter=5, up=up)
    mesh = scene.surroundings(vertices, np.random.default_rng(1))
    things = bodies(mesh)
    assert len(things) == 5 + (1 if kind == "table" else 5)
    axis = np.array(up) / np.linalg.norm(up)
    floor = (vertices @ axis).min()
    S = np.linalg.norm(np.ptp(vertices, axis=0))
    spots = [vertices - np.outer(vertices @ axis, axis)]
    for thing in things:
        assert thing.is_watertight
        assert thing.volume > 0.0
        height = thing.vertices @ axis
        if height.min() < floor - 1e-6 * S:  # the table itself, its top at the floor
            assert height.max() == pytest.approx(floor, abs=1e-9 * S)
        elif np.ptp(height) < 0.4 * S - 1e-9 or kind == "table" or len(thing.faces) > 12:
            assert height.min() == pytest.approx(floor, abs=1e-9 * S)
            spots.append(thing.vertices - np.outer(height, axis))
    # Seen from above, the clutter's circles are apart: no two things share a vertex's neighbourhood.
    middles = np.array([0.5 * (s.min(axis=0) + s.max(axis=0)) for s in spots[:6]])
    gaps = np.linalg.norm(middles[:, None] - middles[None], axis=2) + np.eye(len(middles)) * S
    assert gaps.min() > 0.15 * S


def test_most_points_are_not_the_part_and_the_part_s_are():
    vertices, faces = bracket()
    around = SCENE.surroundings(vertices, np.random.default_rng(2))
    scan = scan_mesh(vertices, faces, SCANNER, rng=np.random.default_rng(0), surroundings=around)
    assert 0.02 < scan.on_part.mean() < 0.5
    assert not scan.is_outlier.any()
    assert (scan.face_index[~scan.on_part] == -1).all()
    plane = vertices[faces[scan.face_index[scan.on_part], 0]]
    off = np.einsum("ni,ni->n", scan.points[scan.on_part] - plane, scan.normals[scan.on_part])
    assert np.abs(off).max() < 1e-11 * 156
    # The others lie on the surroundings: the nearest triangle of these is at hand.
    others = scan.points[~scan.on_part][::40]
    off = trimesh.proximity.closest_point_naive(trimesh.Trimesh(*around, process=False), others)[1]
    assert off.max() < 1e-11 * 1000


def test_outliers_fill_the_whole_scene():
    vertices, faces = bracket()
    around = SCENE.surroundings(vertices, np.random.default_rng(2))
    noise = Noise(outlier_share=0.3)
    scan = scan_mesh(vertices, faces, SCANNER, noise, rng=np.random.default_rng(0), surroundings=around)
    spread = np.ptp(scan.points[scan.is_outlier], axis=0)
    assert (spread[:2] > 3.0 * 156).all()
    assert not (scan.on_part & scan.is_outlier).any()


def test_the_walls_of_a_bin_hide_the_part_from_the_side():
    vertices, faces = feeder(scale=0.3)
    scene = Scene(kind="bin", wall_height=2.0, size=1.5)
    around = scene.surroundings(vertices, np.random.default_rng(0))
    scan = scan_mesh(
        vertices, faces, Scanner(views=((1.0, 0, 0.05),), pixels=40), rng=np.random.default_rng(0), surroundings=around
    )
    assert not scan.on_part.any()


def test_same_seed_same_scene():
    one, two, other = (SCENE.surroundings(bracket()[0], np.random.default_rng(s)) for s in (5, 5, 6))
    assert one[0].tobytes() == two[0].tobytes()
    assert one[0].shape != other[0].shape or not np.allclose(one[0], other[0])


def test_too_much_clutter_is_named():
    with pytest.raises(InputError, match=r"clutter is too large: found room for \d+ of 60"):
        Scene(kind="table", clutter=60, size=2.0).surroundings(bracket()[0], np.random.default_rng(0))


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Scene(kind="shelf"), "kind"),
        (lambda: Scene(kind="table", up=(0, 0, 0)), "up"),
        (lambda: Scene(kind="table", size=0.5), "size"),
        (lambda: Scene(kind="table", size="big"), "size"),
        (lambda: Scene(kind="bin", wall_height=-1.0), "wall_height"),
        (lambda: Scene(kind="table", clutter=1.5), "clutter"),
        (lambda: Scene(kind="table", clutter=10_000), "clutter"),
        (lambda: Scene(clutter=3), "clutter needs"),
    ],
)
def test_impossible_settings_are_named(make, word):
    with pytest.raises(InputError, match=word):
        make()
