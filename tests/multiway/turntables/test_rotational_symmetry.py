"""What is said of parts whose views can be turned about an axis, and of those whose cannot."""

import dataclasses

import numpy as np
import pytest

from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.scans.scans import read_views
from dqreg.multiway.turntables.rotational_symmetry import axis_of_revolution, turnings
from dqreg.rigid import pose
from dqreg.synth.many_views import turntable_views
from dqreg.synth.parts import bracket, flange, gear
from dqreg.trust.records import Alternative, Direction, Reason, Verdict
from tests.multiway.edges_of_truth import registration

VIEWS = 6


def test_the_axis_of_a_cone_is_found_whatever_else_is_there() -> None:
    rng = np.random.default_rng(0)
    angle, height = rng.uniform(0.0, 2.0 * np.pi, 2000), rng.uniform(0.0, 1.0, 2000)
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(2000)])
    points = out * (1.0 - 0.5 * height)[:, None] + [0.0, 0.0, 1.0] * height[:, None] + [3.0, 4.0, 0.0]
    normals = (out + np.array([0.0, 0.0, 0.5])) / np.sqrt(1.25)
    # A tenth lies on faces of any direction.
    normals[:200] = (other := rng.normal(size=(200, 3))) / np.linalg.norm(other, axis=1, keepdims=True)
    axis, point, share = axis_of_revolution(points, normals, 2.0)
    assert abs(axis[2]) > 0.9999
    np.testing.assert_allclose(point[:2] - axis[:2] / axis[2] * point[2], [3.0, 4.0], atol=0.01)
    assert share > 0.85


@pytest.mark.parametrize(("part", "round_part"), [(flange(), True), (bracket(), False)])
def test_views_of_a_nearly_round_part_can_be_turned(part: tuple[np.ndarray, np.ndarray], round_part: bool) -> None:
    made = turntable_views(part, VIEWS, pixels=60, rng=np.random.default_rng(1))
    found = turnings(read_views(list(made.scans), 0), made.T_world_scan, ())
    assert bool(found) == round_part
    if found:
        # The world is the part's frame, and the flange's axis is its z axis.
        assert found[0].angle_rad is None
        assert abs(found[0].axis[2]) > 0.999
        assert np.linalg.norm(np.cross(found[0].axis, found[0].point)) < 0.01 * np.ptp(part[0])


def test_a_rotation_that_several_pairs_name_is_one() -> None:
    made = turntable_views(bracket(), VIEWS, pixels=40, rng=np.random.default_rng(2))
    views, T = read_views(list(made.scans), 0), made.T_world_scan
    half_turn = pose.about(pose.exp(np.r_[0.0, 0.0, np.pi, 0.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0]))

    def edge(i: int, j: int, *, rival: bool) -> Edge:
        known = registration(pose.inverse(T[i]) @ T[j], np.eye(6), np.zeros(3))
        other = Alternative(pose.inverse(T[i]) @ half_turn @ T[j], 0.0)
        return Edge(i, j, dataclasses.replace(known, alternatives=(other,) if rival else ()), used=True)

    assert turnings(views, T, [edge(0, 1, rival=True), edge(1, 2, rival=False)]) == ()
    (found,) = turnings(views, T, [edge(0, 1, rival=True), edge(1, 2, rival=True), edge(2, 3, rival=False)])
    assert found.angle_rad == pytest.approx(np.pi)
    np.testing.assert_allclose(np.abs(found.axis), [0.0, 0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(found.point[:2], [5.0, 0.0], atol=1e-6)


def test_a_turn_that_an_accepted_pair_names_against_the_others_is_one_where_the_model_says_so() -> None:
    teeth = 12
    for part, same in ((gear(teeth=teeth), True), (bracket(), False)):
        made = turntable_views(part, VIEWS, pixels=60, rng=np.random.default_rng(4))
        views, T = read_views(list(made.scans), 0), made.T_world_scan
        turn = pose.exp(np.r_[0.0, 0.0, 2.0 * np.pi / teeth, 0.0, 0.0, 0.0])
        known = registration(pose.inverse(T[0]) @ turn @ T[1], np.eye(6), np.zeros(3))
        found = turnings(views, T, [Edge(0, 1, known, code="contradicts")])
        assert bool(found) == same
        if found:
            # The gear's axis is its z axis.
            assert found[0].angle_rad == pytest.approx(2.0 * np.pi / teeth, abs=1e-6)
            np.testing.assert_allclose(np.abs(found[0].axis), [0.0, 0.0, 1.0], atol=1e-6)


@pytest.mark.parametrize(("corners", "order"), [(6, 6), (4, 4), (0, None)])
def test_a_symmetric_model_is_named_though_no_pair_names_a_rival(corners: int, order: int | None) -> None:
    made = turntable_views(_prism(corners) if corners else bracket(), 12, pixels=60, rng=np.random.default_rng(6))
    views = read_views(list(made.scans), 0)
    found = turnings(views, made.T_world_scan, ())
    assert bool(found) == (order is not None)
    # Where each scan was started, the starts tell.
    assert turnings(views, made.T_world_scan, (), started=True) == ()
    if order is not None:
        # The prism stands along z through the origin.
        assert found[0].angle_rad == pytest.approx(2.0 * np.pi / order, abs=1e-12)
        np.testing.assert_allclose(np.abs(found[0].axis), [0.0, 0.0, 1.0], atol=0.01)
        assert np.linalg.norm(found[0].point[:2]) < 0.02


def _prism(corners: int) -> tuple[np.ndarray, np.ndarray]:
    angles = 2.0 * np.pi * np.arange(corners) / corners
    rim = np.column_stack([np.cos(angles), np.sin(angles)])
    ends = [np.column_stack([rim, np.full(corners, z)]) for z in (-0.45, 0.45)]
    vertices = np.vstack([*ends, [[0.0, 0.0, -0.45], [0.0, 0.0, 0.45]]])
    faces = []
    for k in range(corners):
        n, after = corners, (k + 1) % corners
        faces += [[k, after, n + after], [k, n + after, n + k], [after, k, 2 * n], [n + k, n + after, 2 * n + 1]]
    return vertices, np.array(faces)


def test_pairs_that_hold_no_rotation_name_its_axis_where_nothing_is_placed() -> None:
    rng = np.random.default_rng(5)
    views = read_views([rng.normal(size=(50, 3)), rng.normal(size=(50, 3)), rng.normal(size=(50, 3))], 0)
    loose = Direction(1e-3, 1.0, "a rotation", "rotation", (0.0, 0.0, 1.0), (1.0, 2.0, 0.0))
    verdict = Verdict("suspect", (Reason("made by hand", "weakly_constrained"),))
    known = registration(np.eye(4), np.eye(6), np.zeros(3))
    round_pair = dataclasses.replace(known, observability=(loose,), verdict=verdict)
    held = dataclasses.replace(round_pair, observability=(dataclasses.replace(loose, kind="translation"),))
    nowhere = np.full((3, 4, 4), np.nan)
    (found,) = turnings(views, nowhere, [Edge(0, 1, round_pair), Edge(1, 2, round_pair), Edge(0, 2, held)])
    assert (found.frame, found.angle_rad) == (0, None)
    np.testing.assert_array_equal(found.point, [1.0, 2.0, 0.0])
    assert turnings(views, nowhere, [Edge(0, 1, round_pair), Edge(1, 2, held), Edge(0, 2, held)]) == ()
    # What does not fit says nothing of the part.
    refused = Verdict("suspect", (*verdict.reasons, Reason("made by hand", "random_fit")))
    wrong = dataclasses.replace(round_pair, verdict=refused)
    assert turnings(views, nowhere, [Edge(0, 1, wrong), Edge(1, 2, wrong), Edge(0, 2, wrong)]) == ()
