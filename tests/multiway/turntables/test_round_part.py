"""A part that looks the same however it is turned: a step from how its axis wobbles, and edges of five motions."""

import dataclasses

import numpy as np
import pytest

import dqreg
from dqreg.multiway.pose_graph.edges import Edge, information_of_edge
from dqreg.multiway.turntables.round_part import RoundPart, _line_of, _step_by_wobble, _turned_back, _whole
from dqreg.multiway.turntables.wobble import Line
from dqreg.rigid import pose
from dqreg.synth.many_views import turntable_views
from dqreg.synth.parts.kinds import flange
from dqreg.trust.records import Direction, Reason, Verdict
from tests.multiway.edges_of_truth import edges_of

STEP_RAD, COUNT, SIZE = np.deg2rad(30.0), 12, 2.0
TABLE = pose.about(pose.exp(np.r_[0.0, 0.0, STEP_RAD, 0.0, 0.0, 0.0]), np.array([0.5, -0.2, 0.0]))


def slid_edges(tilt_rad: float, sigma: float = 1e-10) -> list[Edge]:
    """Neighbours on a turntable, each slid about the part's axis by an angle of its own; the axis is tilted."""
    rng = np.random.default_rng(0)
    axis = np.array([np.sin(tilt_rad), 0.0, np.cos(tilt_rad)])
    T = np.array([np.linalg.matrix_power(pose.inverse(TABLE), k) for k in range(COUNT)])
    # The scanner stands still: T takes points of the first view's frame, where the part is, to the k-th one's.
    edges = []
    for edge in edges_of(pose.inverse(T), [(k, k + 1) for k in range(COUNT - 1)], sigma, 0):
        there = T[edge.target]
        line = there[:3, :3] @ axis, there[:3, 3]
        slide = pose.about(pose.exp(np.r_[rng.uniform(-1.0, 1.0) * line[0], 0.0, 0.0, 0.0]), line[1])
        motion = Direction(1e-4, 0.1, "", "rotation", tuple(line[0].tolist()), tuple(line[1].tolist()))
        said = dataclasses.replace(
            edge.registration,
            T_target_source=slide @ edge.registration.T_target_source,
            verdict=Verdict("suspect", (Reason("made by hand", "weakly_constrained"),)),
            observability=(motion,),
            settings={**edge.registration.settings, "diagonal": SIZE},
        )
        edges.append(dataclasses.replace(edge, registration=said))
    return edges


def line_of(edge: Edge) -> Line:
    line = _line_of(edge)
    assert line is not None
    return line


def test_the_step_follows_from_how_a_tilted_axis_goes_round() -> None:
    M = _step_by_wobble([(edge, line_of(edge)) for edge in slid_edges(np.deg2rad(15.0))], SIZE)
    assert M is not None
    # Exact data: what a slide leaves of a point on the axis is rounding.
    np.testing.assert_allclose(M, TABLE, atol=1e-9)
    assert np.linalg.norm(_whole(M, COUNT).as_matrix() - TABLE) < 1e-9


def test_an_axis_that_is_the_tables_tells_no_step() -> None:
    along = [
        dataclasses.replace(edge, registration=dataclasses.replace(edge.registration, observability=(motion,)))
        for edge in slid_edges(0.0)
        for motion in [Direction(1e-4, 0.1, "", "rotation", (0.0, 0.0, 1.0), (0.5, -0.2, 0.0))]
    ]
    assert _step_by_wobble([(edge, line_of(edge)) for edge in along], SIZE) is None


def test_a_pair_is_turned_back_and_says_that_its_rotation_is_free() -> None:
    edge = slid_edges(np.deg2rad(15.0))[2]
    motion = edge.registration.observability[0]
    line = np.array(motion.axis), np.array(motion.point)
    back = _turned_back(edge, TABLE, line).registration.T_target_source
    np.testing.assert_allclose(back, TABLE, atol=1e-9)
    edge = slid_edges(np.deg2rad(15.0), 1e-3)[2]
    centre = np.array(edge.registration.settings["centre"])
    along = np.r_[line[0], np.cross(line[0], centre - line[1])]
    (freed,) = RoundPart(((2, line),), "step").freed([edge])
    before, after = (information_of_edge(each.registration) for each in (edge, freed))
    # What is left along it is that an angle is one of a full turn; across it all is held as before, to rounding.
    assert along @ after @ along == pytest.approx(3.0 / np.pi**2, rel=1e-3)
    across = np.eye(6) - np.outer(before @ along, along) / (along @ before @ along)
    np.testing.assert_allclose(after, across @ before, atol=1e-3 * np.abs(before).max())


@pytest.mark.soak
@pytest.mark.parametrize("order", ["any", "turntable"])
def test_a_flange_is_placed_up_to_its_symmetry(order: str) -> None:
    """Oracle: the true poses of the made views, up to a turn about the flange's axis, z of its own frame."""
    made = turntable_views(flange(), COUNT, pixels=70, noise=1e-4, elevation_deg=35.0, rng=np.random.default_rng(23))
    result = dqreg.register_many(list(made.scans), order=order, effort="fast")
    assert len(result.placed) == COUNT
    assert result.verdict.level == "suspect"
    assert "alternative_poses" in result.verdict.codes
    error = made.T_world_scan[0] @ result.T_world_scan @ pose.inverse(made.T_world_scan)
    vertices, size = flange()[0], np.linalg.norm(np.ptp(flange()[0], axis=0))
    for E in error:
        turn = pose.exp(np.r_[0.0, 0.0, -pose.log(E)[2], 0.0, 0.0, 0.0])
        # A thousandth of the size: ten times the noise, a hundredth of what a wrong pair is off by.
        assert np.linalg.norm(pose.apply(turn @ E, vertices) - vertices, axis=1).max() < 1e-3 * size
