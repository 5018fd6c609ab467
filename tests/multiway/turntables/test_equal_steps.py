import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import PointCloud
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.scans.scans import View
from dqreg.multiway.selection.edge_selection import EdgeSelection, select_edges
from dqreg.multiway.turntables.equal_steps import EqualSteps
from dqreg.multiway.verdict import judge_scans
from dqreg.rigid import DualQuaternion, pose
from dqreg.trust.records import Code, Reason, Verdict
from tests.multiway.edges_of_truth import registration

COUNT, SIGMA, SIZE = 16, 3e-4, 2.0
STEP = DualQuaternion.from_screw([0.2, 1.0, -0.3], 2 * np.pi / COUNT, 0.0, [3.0, 0.0, 1.0]).as_matrix()
CENTRE = np.array([0.4, 0.2, 0.1])
VIEWS = [View(str(k), PointCloud(CENTRE + np.vstack([np.eye(3), -np.eye(3)]))) for k in range(COUNT)]
# Views of a plate's edge: nothing but how well they are held is doubted of their pairs, along the edge.
EDGE_ON, ALONG = (4, 5, 11), np.r_[np.zeros(3), 0.6, 0.0, 0.8]


def poses(steps: list[FloatArray] | None = None) -> FloatArray:
    T = [np.eye(4)]
    for step in steps or [STEP] * (COUNT - 1):
        T.append(T[-1] @ step)
    return np.stack(T)


def on_table(T: FloatArray, seed: int, doubts: tuple[Code, ...] = ("weakly_constrained", "one_plane")) -> list[Edge]:
    """Pairs one and two places apart; those of views of an edge slide along it, and say so."""
    rng, edges = np.random.default_rng(seed), []
    for apart in (1, 2):
        for i in range(COUNT):
            j = (i + apart) % COUNT
            loose = bool({i, j} & set(EDGE_ON))
            covariance = SIGMA**2 * np.eye(6) + (0.1**2 * np.outer(ALONG, ALONG) if loose else 0.0)
            error = SIGMA * rng.normal(size=6) + (0.01 * rng.normal() * ALONG if loose else 0.0)
            measured = pose.about(pose.exp(error), CENTRE) @ pose.inverse(T[i]) @ T[j]
            result = registration(measured, covariance, CENTRE, "suspect" if loose else "accepted")
            if loose:
                verdict = Verdict("suspect", tuple(Reason("made by hand", code) for code in doubts))
                result = dataclasses.replace(result, verdict=verdict)
            edges.append(Edge(i, j, result))
    return edges


def judged(edges: list[Edge], *, steps: bool = True) -> EdgeSelection:
    known = EqualSteps.of(edges, VIEWS, SIZE, 0.0) if steps else None
    return select_edges(edges, COUNT, 0, SIZE, 0.0, {}, known)


def off(selection: EdgeSelection, T: FloatArray) -> FloatArray:
    """Distance of each scan's middle from where it belongs."""
    return np.asarray(np.linalg.norm((selection.T_world_scan[:COUNT] - T) @ np.r_[CENTRE, 1.0], axis=1))


def test_doubted_pairs_that_come_to_the_step_place_views_that_nothing_else_does() -> None:
    T = poses()
    edges = on_table(T, seed=0)
    assert np.isnan(off(judged(edges, steps=False), T)).any()
    selection = judged(edges)
    # The pairs slide by 1e-2; the step is known to 3e-4 over the root of the pairs, which adds up from the first scan.
    assert off(selection, T).max() < 10 * SIGMA
    assert set(EDGE_ON) <= selection.on_steps
    blocks = np.tile(1e-8 * np.eye(6), (COUNT, 1, 1))
    verdict = judge_scans(VIEWS, selection, selection.T_world_scan[:COUNT], blocks, SIZE, converged=True, stopped="")
    assert verdict.level == "suspect"
    assert "unconfirmed_scan" in verdict.codes
    assert "4, 5, 11" in str(verdict.reasons[0])
    assert "table" in str(verdict.reasons[0])


def loose_pairs(T: FloatArray, seed: int) -> list[Edge]:
    """Pairs one and two places apart, none accepted: each slides along an edge of its own, as those of a box do."""
    rng, edges = np.random.default_rng(seed), []
    for apart in (1, 2):
        for i in range(COUNT):
            j, along = (i + apart) % COUNT, np.r_[np.zeros(3), rng.normal(size=3)]
            along /= np.linalg.norm(along)
            error = SIGMA * rng.normal(size=6) + 0.01 * rng.normal() * along
            between = pose.inverse(T[i]) @ T[j] if i < j else DualQuaternion.from_matrix(STEP) ** float(apart)
            between = between if isinstance(between, np.ndarray) else between.as_matrix()
            measured = pose.about(pose.exp(error), CENTRE) @ between
            result = registration(measured, SIGMA**2 * np.eye(6) + 0.1**2 * np.outer(along, along), CENTRE, "suspect")
            verdict = Verdict("suspect", (Reason("made by hand", "unconstrained"),))
            edges.append(Edge(i, j, dataclasses.replace(result, verdict=verdict)))
    return edges


def test_pairs_none_of_which_is_accepted_agree_on_a_step_in_what_they_hold() -> None:
    T = poses()
    selection = judged(loose_pairs(T, seed=2))
    assert off(selection, T).max() < 10 * SIGMA
    steps = EqualSteps.of(loose_pairs(T, seed=2), VIEWS, SIZE, 0.0)
    assert steps is not None
    assert steps.assumed


def test_loose_pairs_that_do_not_come_round_the_table_say_no_step() -> None:
    half = DualQuaternion.from_matrix(STEP) ** 0.9
    edges = loose_pairs(poses([half.as_matrix()] * (COUNT - 1)), seed=3)
    assert EqualSteps.of(edges, VIEWS, SIZE, 0.0) is None


def test_pairs_of_which_something_else_is_doubted_are_not_confirmed_by_steps() -> None:
    T = poses()
    selection = judged(on_table(T, seed=1, doubts=("deviating_patches",)))
    assert not selection.by_steps[
        [row for row, k in enumerate(selection.rows) if selection.edges[k].level != "accepted"]
    ].any()
    assert np.isnan(off(selection, T)).any()


def test_a_doubted_pair_elsewhere_is_not_used() -> None:
    T = poses()
    edges = on_table(T, seed=2)
    row = next(k for k, edge in enumerate(edges) if (edge.target, edge.source) == (4, 5))
    other = pose.about(pose.exp(np.r_[0.0, np.pi, 0.0, 0.0, 0.0, 0.0]), CENTRE)
    moved = dataclasses.replace(
        edges[row].registration, T_target_source=other @ edges[row].registration.T_target_source
    )
    edges[row] = dataclasses.replace(edges[row], registration=moved)
    selection = judged(edges)
    assert not selection.edges[row].used
    assert off(selection, T).max() < 10 * SIGMA


def test_steps_are_a_prior_and_no_law() -> None:
    # The part was knocked between two views: the pairs across say so, each accepted, and all others agree on one step.
    knock = pose.about(pose.exp(np.r_[0.0, 0.1, 0.0, 0.05, 0.0, 0.0]), CENTRE)
    T = poses([STEP if k != 7 else knock @ STEP for k in range(COUNT - 1)])
    T_all = on_table(T, seed=3)
    edges = [edge for edge in T_all if edge.source > edge.target]  # The table was not turned all the way round
    selection = judged(edges)
    assert off(selection, T).max() < 30 * SIGMA
    assert all(edge.used for edge in selection.edges if {edge.target, edge.source} == {7, 8})


def test_unequal_steps_say_nothing() -> None:
    rng = np.random.default_rng(4)
    screw = DualQuaternion.from_matrix(STEP)
    T = poses([(screw ** rng.uniform(0.5, 1.5)).as_matrix() for _ in range(COUNT - 1)])
    assert EqualSteps.of(on_table(T, seed=4), VIEWS, SIZE, 0.0) is None
