import dataclasses
from itertools import pairwise

import numpy as np

from dqreg.multiway.pairwise.pair_runs import PairJob
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.turntables.turntable import on_turntable, step_of
from dqreg.registration.result.result import Registration
from dqreg.rigid import DualQuaternion, pose
from dqreg.trust.records import Reason, Verdict
from tests.multiway.edges_of_truth import registration


def neighbours(count: int, sigma: float, seed: int, wrong: int = 0) -> tuple[list[tuple[int, Edge]], DualQuaternion]:
    rng = np.random.default_rng(seed)
    step = DualQuaternion.from_screw([0.2, 1.0, -0.3], 2 * np.pi / count, 0.0, [3.0, 0.0, 1.0])
    found = []
    for i, j in pairwise(range(count)):
        T = pose.exp(sigma * rng.normal(size=6)) @ step.as_matrix()
        T = pose.random(rng, reach=3.0) if i < wrong else T
        found.append((j - i, Edge(i, j, registration(T, 1e-6 * np.eye(6), np.zeros(3)))))
    return found, step


def test_the_step_is_the_mean_of_those_that_agree() -> None:
    steps, exact = neighbours(24, 1e-3, seed=0, wrong=8)
    table = step_of(steps, 24)
    assert table is not None
    assert table.agreeing >= 15
    # The mean of fifteen: four standard errors.
    np.testing.assert_allclose(table.step.as_matrix(), exact.as_matrix(), atol=4 * 3e-3 / np.sqrt(15))
    np.testing.assert_allclose(table.between(3, 1), pose.inverse(table.between(1, 3)), atol=1e-12)
    assert abs(table.step_deg - 15.0) < 0.1


def test_motions_that_do_not_agree_make_no_table() -> None:
    steps, _ = neighbours(8, 1e-3, seed=1, wrong=7)
    assert step_of(steps, 8) is None


def test_steps_that_are_a_little_off_together_neither_bend_the_mean_nor_agree_with_it() -> None:
    # A part that looks nearly the same after a small shift: a third of the pairs stand there, each accepted.
    steps, exact = neighbours(24, 1e-4, seed=2)
    shift = pose.from_parts(np.eye(3), 0.08 * np.linalg.norm(exact.as_matrix()[:3, 3]) * np.array([0.6, 0.0, 0.8]))
    for k in range(0, 21, 3):
        wrong = shift @ steps[k][1].registration.T_target_source
        steps[k] = 1, Edge(k, k + 1, registration(wrong, 1e-6 * np.eye(6), np.zeros(3)))
    table = step_of(steps, 24)
    assert table is not None
    assert table.agreeing >= 14
    np.testing.assert_allclose(table.step.as_matrix(), exact.as_matrix(), atol=4 * 3e-4 / np.sqrt(14))
    odd = [edge.target for places, edge in steps if table.contradicts(edge, places)]
    assert odd == list(range(0, 21, 3))


def doubted(said: Registration, code: str | None) -> Registration:
    reasons = (Reason("made by hand", code),) if code else ()  # type: ignore[arg-type]
    return dataclasses.replace(said, verdict=Verdict("suspect", reasons)) if code else said


class Runner:
    """Ends where a job begins, accepted; but for some pairs, which end elsewhere."""

    def __init__(self, elsewhere: set[tuple[int, int]], said: dict[tuple[int, int], str] | None = None) -> None:
        self.elsewhere, self.said, self.jobs = elsewhere, said or {}, list[PairJob]()

    def run(self, jobs: list[PairJob]) -> list[Edge]:
        self.jobs += jobs
        away = pose.from_parts(np.eye(3), np.array([0.0, 0.0, 1.0]))
        ends = [job.start @ away if (job.target, job.source) in self.elsewhere else job.start for job in jobs]
        return [
            Edge(job.target, job.source, doubted(registration(T, 1e-6 * np.eye(6), np.zeros(3)), code))
            for job, T in zip(jobs, ends, strict=True)
            for code in [self.said.get((job.target, job.source))]
        ]


def test_an_accepted_neighbour_elsewhere_gives_way_to_one_as_good_at_the_table() -> None:
    count = 12
    steps, exact = neighbours(count, 1e-5, seed=4)
    for k in (2, 5):
        wrong = pose.from_parts(np.eye(3), np.array([0.3, 0.0, 0.0])) @ steps[k][1].registration.T_target_source
        steps[k] = 1, Edge(k, k + 1, registration(wrong, 1e-6 * np.eye(6), np.zeros(3)))
    before = [edge for _, edge in steps]
    runner = Runner({(5, 6), (0, 2)})
    found = {(e.target, e.source): e for e in on_turntable(runner, before, range(count))}  # type: ignore[arg-type]
    assert all(job.near for job in runner.jobs)
    np.testing.assert_allclose(found[2, 3].registration.T_target_source, exact.as_matrix(), atol=1e-3)
    # What ends elsewhere is not taken, and never a right neighbour's place.
    assert found[5, 6] is before[5]
    assert (0, 2) not in found
    assert (1, 3) in found
    assert all(found[k, k + 1] is before[k] for k in range(count - 1) if k != 2)


def test_such_a_neighbour_gives_way_to_a_pose_at_the_table_that_nothing_speaks_against() -> None:
    count = 12
    steps, exact = neighbours(count, 1e-5, seed=4)
    for k in (2, 5):
        wrong = pose.from_parts(np.eye(3), np.array([0.3, 0.0, 0.0])) @ steps[k][1].registration.T_target_source
        steps[k] = 1, Edge(k, k + 1, registration(wrong, 1e-6 * np.eye(6), np.zeros(3)))
    before = [edge for _, edge in steps]
    runner = Runner(set(), {(2, 3): "weakly_constrained", (5, 6): "random_fit"})
    found = {(e.target, e.source): e for e in on_turntable(runner, before, range(count))}  # type: ignore[arg-type]
    np.testing.assert_allclose(found[2, 3].registration.T_target_source, exact.as_matrix(), atol=1e-3)
    assert found[5, 6] is before[5]
