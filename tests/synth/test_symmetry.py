from __future__ import annotations

import ast
import functools

import numpy as np
import pytest

from dqreg.geometry.mesh import Mesh
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.rigid import pose
from dqreg.synth import parts
from dqreg.synth.parts.kinds import about_z, of_box
from dqreg.synth.truth import nearest_truth, worst_vertex_displacement

CASES = [
    *((kind, {}) for kind in parts.KINDS),
    ("box", {"size": (2.0, 2.0, 2.0)}),
    ("box", {"size": (3.0, 2.0, 3.0)}),
    ("flange", {"bolts": 5}),
    ("gear", {"teeth": 11, "hub_diameter": 30.0}),
    ("plate", {"large_hole": 9.0}),
    ("plate", {"size": (60.0, 60.0, 4.0)}),
    ("plate", {"size": (60.0, 60.0, 4.0), "large_hole": 9.0}),
    ("prism", {"sides": 5}),
    ("prism", {"sides": 4, "diameter": 2.0**0.5, "height": 1.0}),
]
COUNTS = {"angle": 1, "blade": 1, "block": 1, "box": 24, "bracket": 1, "cylinder": 2, "feeder": 1, "flange": 6,
          "gear": 18, "plate": 1, "prism": 12}  # fmt: skip


def distance_off(kind, dimensions, T) -> float:
    """Greatest distance of moved vertices and face centres from the surface, in diagonals: an oracle by geometry."""
    surface, probes = surface_of(kind, repr(dimensions))
    return float(surface.closest(pose.apply(T, probes)).distances.max() / surface.diagonal)


@functools.cache
def surface_of(kind, dimensions):
    mesh = Mesh(*parts.KINDS[kind].build(**ast.literal_eval(dimensions)))
    probes = np.concatenate([mesh.vertices, mesh.corners.mean(axis=1)])
    return MeshSurface(mesh), probes[:: 1 + len(probes) // 400]


def test_the_counts_are_known():
    assert {kind: len(parts.symmetry_of(kind).poses) for kind in parts.KINDS} == COUNTS


@pytest.mark.parametrize(("kind", "dimensions"), CASES)
def test_symmetries_put_the_part_onto_itself_and_near_ones_do_not(kind, dimensions):
    symmetry = parts.symmetry_of(kind, dimensions)
    np.testing.assert_allclose(symmetry.poses[0], np.eye(4), atol=1e-15)
    for T in symmetry.poses:
        assert distance_off(kind, dimensions, T) < 1e-12
    for T in symmetry.near:
        assert 0.005 < distance_off(kind, dimensions, T) < 0.1


@pytest.mark.parametrize(("kind", "dimensions"), CASES)
def test_symmetries_are_a_group_of_different_motions(kind, dimensions):
    T = parts.symmetry_of(kind, dimensions).poses
    products = (T[:, None] @ T[None]).reshape(-1, 1, 4, 4)
    same = np.abs(products - T).max(axis=(2, 3)) < 1e-9 * np.abs(T).max()
    assert (same.sum(axis=1) == 1).all()


@pytest.mark.parametrize("kind", ["angle", "blade", "block", "bracket", "feeder", "plate"])
def test_parts_with_one_truth_have_no_other(kind):
    # Any other motion would keep the box: of the turns of a box, only the identity leaves the surface in place.
    vertices, _ = parts.KINDS[kind].build()
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    for T in of_box([1.0, 1.0, 1.0]):
        turned = pose.about(T, 0.5 * (low + high))
        if not np.allclose(turned, np.eye(4)):
            assert distance_off(kind, {}, turned) > 0.01


@pytest.mark.parametrize(("kind", "fold"), [("gear", 36), ("flange", 12), ("prism", 12)])
def test_half_a_step_is_no_symmetry(kind, fold):
    assert distance_off(kind, {}, about_z(fold)[1]) > 0.01


def test_a_round_part_may_be_turned_by_any_angle():
    symmetry = parts.symmetry_of("cylinder")
    vertices, _ = parts.cylinder(segments=96)
    point, direction = symmetry.axis
    rng = np.random.default_rng(0)
    truth = pose.random(rng, reach=3.0)
    truths = symmetry.poses @ truth
    for angle, flip in ((0.3, 0), (1.234, 1), (-3.0, 1)):
        turn = pose.about(pose.exp(np.concatenate([angle * direction, np.zeros(3)])), point)
        T = turn @ truths[flip]
        assert nearest_truth(T, truths, vertices, (point, direction))[1] < 1e-12
        assert nearest_truth(T, truths, vertices)[1] > 0.1  # without the axis the same pose is far from any truth
    off = pose.from_parts(np.eye(3), [0.0, 0.0, 0.25]) @ truth
    assert nearest_truth(off, truths, vertices, (point, direction))[1] == pytest.approx(0.25)


def test_the_nearest_of_several_truths_is_found():
    truth = pose.random(np.random.default_rng(1), reach=100.0)
    truths = parts.symmetry_of("gear").poses @ truth
    vertices, _ = parts.gear()
    shift = pose.from_parts(np.eye(3), [0.0, 0.3, 0.4])
    found, worst = nearest_truth(shift @ truths[7], truths, vertices)
    np.testing.assert_allclose(found, truths[7], atol=1e-12)
    assert worst == pytest.approx(0.5, rel=1e-12)
    assert worst_vertex_displacement(truths[7] @ pose.inverse(truths[0]), np.eye(4), vertices) > 40.0
