"""The steps of a turntable as a prior: as sure as steps agree, silent where they do not, and never a law."""

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pose_graph.graph import PoseGraph
from dqreg.multiway.refinement.bodies import Body
from dqreg.multiway.refinement.common_planes import refine_on_planes
from dqreg.multiway.refinement.step_prior import step_prior
from dqreg.multiway.scans.scans import read_views, typical_spacing
from dqreg.multiway.visibility.sides import body_of
from dqreg.rigid import DualQuaternion, pose

COUNT, SIGMA = 24, 1e-5
FREE = np.arange(1, COUNT)
SCREW = DualQuaternion.from_screw([0.2, 1.0, -0.3], 2 * np.pi / COUNT, 0.0, [1.5, 0.0, 0.8])


def table(rng: np.random.Generator, jitter: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """True poses of centred frames, the same a little off, and origins; each angle of the table errs by the jitter."""
    origins = 0.05 * rng.normal(size=(COUNT, 3)) + 0.3
    angles = np.arange(COUNT) + jitter * rng.normal(size=COUNT) / (2 * np.pi / COUNT)
    truth = (SCREW**angles).as_matrix() @ pose.from_parts(np.eye(3), origins)
    middle = pose.from_parts(np.eye(3), -truth[:, :3, 3].mean(axis=0))
    truth = middle @ truth
    off = pose.exp(SIGMA * rng.normal(size=(COUNT, 6)))
    off[0] = np.eye(4)
    return truth, off @ truth, origins


def prior(T: FloatArray, origins: FloatArray) -> PoseGraph | None:
    return step_prior(T, SIGMA**2 * np.eye(6 * (COUNT - 1)), FREE, origins, range(COUNT), COUNT)


def test_the_prior_is_as_sure_as_the_places_of_the_table_are() -> None:
    for jitter in (0.0, 1e-4, 2e-3):
        chi2 = []
        for seed in range(12):
            truth, T, origins = table(np.random.default_rng(seed), jitter)
            graph = prior(T, origins)
            assert graph is not None
            # Nothing but the angle errs, one degree of freedom, and what the poses do is left in part.
            chi2.append(graph.chi2(truth).mean())
        assert 0.2 < np.mean(chi2) < 3.0 if jitter else np.mean(chi2) < 3.0
        widest = np.sqrt(np.linalg.eigvalsh(np.linalg.inv(graph.information[0]))[-1])
        assert widest < 6.0 * (SIGMA + jitter)


def test_a_step_that_is_another_is_left_out_and_steps_without_a_rule_say_nothing() -> None:
    rng = np.random.default_rng(1)
    _, T, origins = table(rng, 0.0)
    knocked = T.copy()
    knocked[9:] = pose.exp(np.r_[0.0, 0.02, 0.0, 0.01, 0.0, 0.0]) @ knocked[9:]
    graph = prior(knocked, origins)
    assert graph is not None
    pairs = set(zip(graph.targets.tolist(), graph.sources.tolist(), strict=True))
    assert (8, 9) not in pairs
    assert (COUNT - 1, 0) not in pairs
    assert len(pairs) == COUNT - 2
    anywhere = np.stack([pose.random(rng, reach=1.0) for _ in range(COUNT)])
    assert prior(anywhere, origins) is None
    assert step_prior(T[:7], SIGMA**2 * np.eye(36), np.arange(1, 7), origins[:7], range(7), 7) is None


def test_steps_hold_what_no_face_of_a_scan_does() -> None:
    # A floor, and two walls that the fifth scan does not see: begun a hundredth off along the floor, it stays there.
    rng, count, noise, off = np.random.default_rng(5), 14, 1e-4, np.array([0.01, -0.01, 0.0])
    step = DualQuaternion.from_screw([0.1, 0.3, 1.0], 2 * np.pi / count, 0.0, [0.4, 0.1, 0.0])
    truth, scans = [], []
    for k in range(count):
        floor = np.column_stack([rng.uniform(-0.5, 0.5, (150, 2)), np.zeros(150)])
        along, up = rng.uniform(-0.5, 0.5, (2, 40)), rng.uniform(0.0, 0.2, (2, 40))
        half = np.full(40, 0.5)
        walls = [np.column_stack([half, along[0], up[0]]), np.column_stack([along[1], half, up[1]])]
        points = np.concatenate([floor, *([] if k == 5 else walls)])
        T = (step ** float(k)).as_matrix()
        scans.append(pose.apply(pose.inverse(T), points + noise * rng.normal(size=points.shape)))
        truth.append(T)
    views = read_views(scans, 0)
    bodies: list[Body] = [body_of(view, None) for view in views]
    exact = np.stack(truth) @ pose.from_parts(np.eye(3), np.array([view.origin for view in views]))
    begun = exact.copy()
    begun[5, :3, 3] += off
    errors = []
    for on_table in (None, (range(count), count)):
        found = refine_on_planes(bodies, begun, np.arange(1, count), typical_spacing(views), 1.0, on_table)
        assert found is not None
        assert found.converged
        assert found.by_steps == (on_table is not None)
        errors.append(np.linalg.norm((found.T_world_body - exact)[5, :3, 3]))
    assert errors[0] > 0.9 * np.linalg.norm(off)
    assert errors[1] < 2.0 * noise
