from __future__ import annotations

import numpy as np
import pytest
import trimesh

from dqreg.errors import InputError
from dqreg.synth import parts

ALL = [parts.box, parts.bracket, parts.cylinder, parts.plate]


def as_trimesh(mesh: parts.Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(*mesh, process=False)


@pytest.mark.parametrize("part", ALL)
def test_is_closed_and_looks_outwards(part):
    mesh = as_trimesh(part())
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    assert mesh.body_count == 1


@pytest.mark.parametrize("part", ALL)
def test_arrays_are_plain_and_every_vertex_is_used(part):
    vertices, faces = part()
    assert vertices.dtype == np.float64
    assert faces.dtype == np.int64
    assert np.array_equal(np.unique(faces), np.arange(len(vertices)))
    assert as_trimesh((vertices, faces)).area_faces.min() > 0.0


@pytest.mark.parametrize("part", ALL)
def test_stays_closed_when_rounded_to_float32(part):
    vertices, faces = part()
    rounded = vertices.astype(np.float32)
    assert len(np.unique(rounded, axis=0)) == len(vertices)
    assert as_trimesh((rounded, faces)).is_watertight


# Genus by Euler's formula: 2 - 2 g, one for each through-hole.
@pytest.mark.parametrize(("part", "holes"), [(parts.box, 0), (parts.cylinder, 0), (parts.plate, 4), (parts.bracket, 5)])
def test_has_the_right_number_of_through_holes(part, holes):
    assert as_trimesh(part()).euler_number == 2 - 2 * holes


def bracket_volume(length, width, height, base, wall, r, large, small, boss, boss_height, bore) -> float:
    plates = length * width * base + wall * width * (height - base)
    fillet = (r**2 - np.pi * r**2 / 4) * width
    holes = np.pi / 4 * base * (large**2 + 3 * small**2)
    raised = np.pi / 4 * boss**2 * boss_height - np.pi / 4 * bore**2 * (boss_height + wall)
    return plates + fillet - holes + raised


def test_bracket_volume_is_that_of_its_solids():
    # 48 facets a round lose 0.3 % of the round's volume, 0.05 % of the part's.
    expected = bracket_volume(120, 80, 60, 10, 12, 10, 16, 9, 28, 10, 14)
    assert as_trimesh(parts.bracket()).volume == pytest.approx(expected, rel=5e-4)


def test_bracket_volume_follows_its_dimensions():
    mesh = parts.bracket(
        length=90, width=70, height=75, base_thickness=8, wall_thickness=9, fillet_radius=15, large_hole=20,
        small_hole=5, boss_diameter=24, boss_height=13, bore_diameter=6, boss_position=0.6, segments=192,
    )  # fmt: skip
    assert as_trimesh(mesh).volume == pytest.approx(bracket_volume(90, 70, 75, 8, 9, 15, 20, 5, 24, 13, 6), rel=5e-5)


def test_bracket_has_no_symmetry():
    # Under each of the turns that keep its box, the moved vertices leave the part's surface.
    vertices, faces = parts.bracket()
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    mesh = as_trimesh((vertices, faces))
    for signs in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1]):
        moved = (vertices - centre) * signs + centre
        _, distance, _ = trimesh.proximity.closest_point_naive(mesh, moved[::7])
        assert distance.max() > 5.0


def test_fillet_facets_lie_on_its_radius():
    vertices, _ = parts.bracket()
    # The axis of the fillet runs along y at x = 22, z = 20, with the default dimensions.
    radius = np.hypot(vertices[:, 0] - 22.0, vertices[:, 2] - 20.0)
    inner = (vertices[:, 0] > 12.0) & (vertices[:, 0] < 22.0) & (vertices[:, 2] > 10.0) & (vertices[:, 2] < 20.0)
    assert inner.sum() == 2 * 11
    np.testing.assert_allclose(radius[inner], 10.0, rtol=1e-14)


def test_box_is_centred_and_divided():
    vertices, faces = parts.box(size=(4.0, 2.0, 6.0), divisions=(2, 1, 3))
    np.testing.assert_array_equal(vertices.max(axis=0), [2.0, 1.0, 3.0])
    np.testing.assert_array_equal(vertices.min(axis=0), [-2.0, -1.0, -3.0])
    assert len(faces) == 4 * (2 * 1 + 1 * 3 + 2 * 3)
    mesh = as_trimesh((vertices, faces))
    assert mesh.volume == pytest.approx(48.0, rel=1e-14)
    assert mesh.is_watertight


def test_cylinder_volume_is_that_of_its_prism():
    expected = 12 / 2 * np.sin(2 * np.pi / 12) * 1.5**2 * 4.0
    assert as_trimesh(parts.cylinder(diameter=3.0, height=4.0, segments=12)).volume == pytest.approx(
        expected, rel=1e-14
    )


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: parts.bracket(length=-1.0), "length"),
        (lambda: parts.bracket(width=float("nan")), "width"),
        (lambda: parts.bracket(height="60"), "height"),
        (lambda: parts.bracket(fillet_radius=200.0), "fillet_radius"),
        (lambda: parts.bracket(large_hole=60.0), "diameter 60"),
        (lambda: parts.bracket(boss_position=0.99), "does not fit"),
        (lambda: parts.bracket(bore_diameter=30.0), "bore_diameter"),
        (lambda: parts.bracket(segments=10), "segments"),
        (lambda: parts.plate(large_hole=0.0), "large_hole"),
        (lambda: parts.box(size=(1.0, 2.0)), "size"),
        (lambda: parts.box(size=(1.0, 2.0, 0.0)), r"size\[2\]"),
        (lambda: parts.box(divisions=0), "divisions"),
        (lambda: parts.cylinder(height=0.0), "height"),
        (lambda: parts.cylinder(segments=4), "segments"),
    ],
)
def test_impossible_dimensions_are_named(make, word):
    with pytest.raises(InputError, match=word):
        make()
