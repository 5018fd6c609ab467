from __future__ import annotations

import numpy as np
import pytest
import trimesh

from dqreg.errors import InputError
from dqreg.synth import parts

ALL = [kind.build for kind in parts.KINDS.values()]


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
@pytest.mark.parametrize(
    ("part", "holes"),
    [
        (parts.angle, 3),
        (parts.blade, 0),
        (parts.block, 0),
        (parts.box, 0),
        (parts.bracket, 5),
        (parts.cylinder, 0),
        (parts.feeder, 0),
        (parts.flange, 7),
        (parts.gear, 1),
        (parts.plate, 4),
        (parts.prism, 0),
    ],
)
def test_has_the_right_number_of_through_holes(part, holes):
    assert as_trimesh(part()).euler_number == 2 - 2 * holes


@pytest.mark.parametrize("part", ALL)
def test_triangles_are_not_splinters(part):
    # Longest edge over height: the worst are between a hole's facet and a far corner.
    vertices, faces = part()
    longest = np.linalg.norm(vertices[faces] - np.roll(vertices[faces], 1, axis=1), axis=2).max(axis=1)
    height = 2.0 * as_trimesh((vertices, faces)).area_faces / longest
    assert (longest / height).max() < 200.0


def polygon_area(diameter: float, corners: int) -> float:
    return corners / 2 * np.sin(2 * np.pi / corners) * (diameter / 2) ** 2


def test_flange_volume_is_that_of_its_solids():
    # With 400 facets a round loses 4e-5 of itself at most.
    mesh = as_trimesh(parts.flange(segments=400))
    disc = np.pi / 4 * (120.0**2 - 36.0**2 - 6 * 11.0**2) * 14.0
    assert mesh.volume == pytest.approx(disc + np.pi / 4 * (58.0**2 - 36.0**2) * 22.0, rel=1e-4)


def test_flange_bolt_holes_are_where_they_are_asked_for():
    vertices, _ = parts.flange(bolts=5, segments=12)
    middles = 46.0 * np.column_stack([np.cos(np.arange(5) * 2 * np.pi / 5), np.sin(np.arange(5) * 2 * np.pi / 5)])
    gaps = np.linalg.norm(vertices[:, None, :2] - middles, axis=2)
    on_hole = np.abs(gaps - 5.5) < 1e-9
    assert (on_hole.sum(axis=0) == 2 * 12).all()  # a rim above and one below
    assert gaps.min() > 5.5 - 1e-9  # and nothing inside


def test_gear_volume_is_the_integral_of_its_tooth_law():
    # Half the angle of an involute tooth at radius r is pi / (2 z) + inv 20 - inv acos(r_b / r).
    teeth, module, width, bore, hub, hub_height = 18, 4.0, 16.0, 20.0, 36.0, 10.0
    pitch = teeth * module / 2
    base, root, tip = pitch * np.cos(np.deg2rad(20)), pitch - 1.25 * module, pitch + module

    def inv(a):
        return np.tan(a) - a

    r = np.linspace(root, tip, 200_001)
    half = np.pi / (2 * teeth) + inv(np.deg2rad(20)) - inv(np.arccos(np.minimum(1, base / r)))
    tooth = np.trapezoid(2 * half * r, r)
    expected = (np.pi * root**2 + teeth * tooth - np.pi / 4 * bore**2) * width
    expected += np.pi / 4 * (hub**2 - bore**2) * hub_height
    # Between teeth the root circle is a chord; many teeth's facets cut 1 % of little.
    assert as_trimesh(parts.gear(flank_facets=100)).volume == pytest.approx(expected, rel=6e-3)


def test_gear_pitch_thickness_is_half_the_pitch():
    # An independent law of the involute: at the pitch circle tooth and gap are equally wide.
    vertices, _ = parts.gear(teeth=20, module=2.0, bore_diameter=8.0, hub_diameter=16.0, flank_facets=200)
    r, angle = np.hypot(*vertices[:, :2].T), np.arctan2(vertices[:, 1], vertices[:, 0])
    near = (np.abs(r - 20.0) < 0.03) & (np.abs(angle) < np.pi / 20)
    assert near.sum() >= 4
    np.testing.assert_allclose(np.abs(angle[near]), np.pi / 40, rtol=0.02)


def test_blade_volume_is_the_integral_of_its_sections():
    # NACA four-digit half thickness 5 t (0.2969 sqrt x - ... - 0.1036 x^4) + 0.01 x, integrated by hand.
    half = 5 * 0.13 * (0.2969 * 2 / 3 - 0.1260 / 2 - 0.3516 / 3 + 0.2843 / 4 - 0.1036 / 5) + 0.01 / 2
    aerofoil = 2 * half * 46.0**2 * 90.0 * (1 + 0.6 + 0.36) / 3
    mesh = as_trimesh(parts.blade(stations=150, sections=60))
    assert mesh.volume == pytest.approx(aerofoil + 62 * 34 * 12, rel=1e-3)


def test_blade_sections_turn_and_taper():
    vertices, _ = parts.blade(twist_rad=np.deg2rad(30), taper=0.5)
    tip = vertices[vertices[:, 2] == vertices[:, 2].max()][:, :2]
    root = vertices[np.isclose(vertices[:, 2], 12.0) & (np.abs(vertices[:, 1]) < 16.9)][:, :2]
    c, s = np.cos(np.deg2rad(30)), np.sin(np.deg2rad(30))
    turned = 0.5 * root[np.abs(root[:, 0]) < 30.9] @ np.array([[c, s], [-s, c]])
    gaps = np.linalg.norm(tip[:, None] - turned, axis=2)
    assert len(tip) == 41
    assert gaps.min(axis=1).max() < 1e-12


def test_angle_volume_is_that_of_its_legs_and_bend():
    mesh = as_trimesh(parts.angle(segments=400))
    flat = ((90 - 6) + (60 - 6)) * 2.0 * 70.0
    bend = np.pi / 4 * (6.0**2 - 4.0**2) * 70.0
    holes = np.pi / 4 * (14.0**2 + 2 * 8.0**2) * 2.0
    assert mesh.volume == pytest.approx(flat + bend - holes, rel=1e-5)


def test_prism_and_block_volumes_are_exact():
    assert as_trimesh(parts.prism()).volume == pytest.approx(polygon_area(60.0, 6) * 40.0, rel=1e-14)
    assert as_trimesh(parts.block()).volume == pytest.approx(80 * 50 * 30 - 6**3, rel=1e-14)
    missing = parts.block()[0] - np.array([40.0, 25.0, 15.0])
    assert (np.abs(missing).sum(axis=1) > 5.0).all()  # the corner itself is gone


def test_feeder_has_the_vertices_that_the_paper_s_tables_use():
    from dqreg.synth.parts.blocks import feeder_vertices

    vertices, _ = parts.feeder()
    np.testing.assert_array_equal(vertices, np.unique(feeder_vertices(), axis=0))
    np.testing.assert_array_equal(np.ptp(vertices, axis=0), [322.0, 84.0, 151.0])
    lower, upper = 322 * 52 + (236 - 78) * 32, (255 - 34) * 35 + (201 - 109) * 25
    assert as_trimesh(parts.feeder()).volume == pytest.approx(lower * 88 + upper * 63, rel=1e-14)


@pytest.mark.parametrize(
    ("part", "dimensions"),
    [
        (parts.flange, {"bolts": 3, "bolt_diameter": 18.0}),
        (parts.flange, {"bolts": 24, "bolt_diameter": 6.0}),
        (parts.flange, {"bolts": 5}),
        (parts.flange, {"bolts": 7, "segments": 40}),
        (parts.gear, {"teeth": 60, "module": 1.5}),
        (parts.gear, {"teeth": 8, "bore_diameter": 8.0, "hub_diameter": 12.0}),
        (parts.gear, {"teeth": 200, "module": 1.0, "flank_facets": 1}),
        (parts.blade, {"twist_rad": 0.0, "taper": 1.0, "camber": 0.2, "thickness": 0.3, "chord": 40.0}),
        (parts.blade, {"twist_rad": 1.5, "stations": 4, "sections": 2}),
        (parts.angle, {"thickness": 0.1, "bend_radius": 0.1}),
        (parts.prism, {"sides": 3}),
        (parts.block, {"notch": 29.0}),
        (parts.feeder, {"scale": 1e-3}),
    ],
)
def test_other_dimensions_are_closed_too(part, dimensions):
    vertices, faces = part(**dimensions)
    mesh = as_trimesh((vertices, faces))
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    assert mesh.area_faces.min() > 0.0
    assert np.array_equal(np.unique(faces), np.arange(len(vertices)))


@pytest.mark.parametrize("part", [parts.flange, parts.gear, parts.blade, parts.angle, parts.feeder, parts.block])
def test_flat_faces_do_not_fold_over(part):
    # On every plane the areas of the triangles add up to the area that they cover: no triangle is turned over.
    mesh = as_trimesh(part())
    corners = mesh.triangles[np.abs(mesh.face_normals[:, 2]) > 1 - 1e-12]
    heights = corners[:, 0, 2].round(9)
    rng = np.random.default_rng(0)
    for z in np.unique(heights):
        for sign in (1, -1):
            a, b, c = np.moveaxis(corners[heights == z][:, ::sign, :2], 1, 0)
            area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
            a, b, c = a[area > 0], b[area > 0], c[area > 0]
            if not len(a):
                continue
            low, high = np.min([a, b, c], axis=(0, 1)), np.max([a, b, c], axis=(0, 1))
            points = rng.uniform(low, high, (300, 2))[:, None]

            def left(p, q, points=points):
                return (q - p)[:, 0] * (points - p)[..., 1] - (q - p)[:, 1] * (points - p)[..., 0] > 0

            assert (left(a, b) & left(b, c) & left(c, a)).sum(axis=1).max() <= 1


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
        (lambda: parts.cylinder(segments="many"), "segments"),
        (lambda: parts.cylinder(segments=4_000_000), "segments"),
        (lambda: parts.box(divisions=100_000), "divisions"),
        (lambda: parts.box(size=(1.0, "2", 3.0)), "size"),
        (lambda: parts.flange(bolts=2), "bolts"),
        (lambda: parts.flange(bolts=6.0), "bolts"),
        (lambda: parts.flange(bolt_diameter=30.0), "bolt_diameter"),
        (lambda: parts.flange(bolts=40), "bolt_diameter"),
        (lambda: parts.flange(bore_diameter=70.0), "bore_diameter"),
        (lambda: parts.gear(teeth=5), "teeth"),
        (lambda: parts.gear(module=0.0), "module"),
        (lambda: parts.gear(hub_diameter=70.0), "hub_diameter"),
        (lambda: parts.blade(chord=70.0), "chord"),
        (lambda: parts.blade(twist_rad=2.0), "twist_rad"),
        (lambda: parts.blade(taper=1.5), "taper"),
        (lambda: parts.blade(stations=1), "stations"),
        (lambda: parts.angle(thickness=50.0, bend_radius=50.0), "bend"),
        (lambda: parts.angle(large_hole=60.0), "diameter 60"),
        (lambda: parts.block(notch=40.0), "notch"),
        (lambda: parts.prism(sides=2), "sides"),
        (lambda: parts.feeder(scale=-1.0), "scale"),
    ],
)
def test_impossible_dimensions_are_named(make, word):
    with pytest.raises(InputError, match=word):
        make()
