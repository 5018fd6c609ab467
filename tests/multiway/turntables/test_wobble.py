"""Pairs of a part with many like teeth, each a number of teeth off: the part's axis tells the step of the table."""

import dataclasses

import numpy as np

from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.turntables.turntable import step_by_axis, step_of
from dqreg.rigid import pose
from dqreg.trust.records import Alternative, Reason, Verdict
from tests.multiway.edges_of_truth import edges_of

COUNT, SIZE, TOOTH_RAD, STEP_RAD = 12, 2.0, np.deg2rad(15.0), np.deg2rad(30.0)
TABLE = pose.about(pose.exp(np.r_[0.0, 0.0, STEP_RAD, 0.0, 0.0, 0.0]), np.array([0.5, -0.2, 0.0]))


def pairs_teeth_off(tilt_rad: float, named: int, on_axis: bool = False) -> list[tuple[int, Edge]]:
    """Neighbours on a table, each some teeth off; every so many-th one names another tooth, one is upside down."""
    rng = np.random.default_rng(0)
    axis = np.array([np.sin(tilt_rad), 0.0, np.cos(tilt_rad)])
    T = np.array([np.linalg.matrix_power(pose.inverse(TABLE), k) for k in range(COUNT)])
    found = []
    for edge in edges_of(pose.inverse(T), [(k, k + 1) for k in range(COUNT - 1)], 1e-10, 0):
        there = T[edge.target]
        line = there[:3, :3] @ axis, pose.apply(there, np.array([[0.5, -0.2, 0.3]]) if on_axis else np.zeros((1, 3)))[0]
        tooth = pose.about(pose.exp(np.r_[TOOTH_RAD * line[0], np.zeros(3)]), line[1])
        off = np.linalg.matrix_power(tooth, int(rng.integers(-3, 4))) @ edge.registration.T_target_source
        if edge.target == 4:
            across = np.cross(line[0], [0.3, -0.4, 0.1])
            turn = pose.exp(np.r_[np.pi * across / np.linalg.norm(across), np.zeros(3)])
            off = pose.about(turn, line[1] + 0.02 * line[0]) @ off
        rivals = (Alternative(tooth @ off, 1.0, 0.5),) if edge.target % named == 0 else ()
        code = "alternative_poses" if rivals else "weakly_constrained"
        said = dataclasses.replace(
            edge.registration,
            T_target_source=off,
            alternatives=rivals,
            verdict=Verdict("suspect", (Reason("made by hand", code),)),  # type: ignore[arg-type]
            settings={**edge.registration.settings, "diagonal": SIZE},
        )
        found.append((1, dataclasses.replace(edge, registration=said)))
    return found


def test_pairs_teeth_off_tell_the_step_by_their_rivals() -> None:
    steps = pairs_teeth_off(np.deg2rad(25.0), named=3)
    assert step_of(steps, COUNT) is None
    table = step_by_axis(steps, SIZE)
    assert table is not None
    # Exact data: what teeth leave of a point on the axis is rounding.
    np.testing.assert_allclose(table.step.as_matrix(), TABLE, atol=1e-8)
    assert table.agreeing >= 8


def test_an_axis_along_the_tables_tells_no_step() -> None:
    assert step_by_axis(pairs_teeth_off(0.0, named=2, on_axis=True), SIZE) is None
