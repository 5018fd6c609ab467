"""What few points hold, of a scan and of a group of them: unknown without steps of a table, and held by these."""

import numpy as np
import pytest
import scipy.sparse as sparse

from dqreg._arrays import FloatArray, IntArray
from dqreg.multiway.pose_graph.loops import CHI2_LIMIT
from dqreg.multiway.refinement.bodies import Body
from dqreg.multiway.refinement.common_planes import PlacedBodies, refine_on_planes
from dqreg.multiway.refinement.unconstrained_motions import without_loose_motions
from dqreg.multiway.scans.scans import read_views, typical_spacing
from dqreg.multiway.visibility.sides import body_of
from dqreg.rigid import DualQuaternion, pose

COUNT, NOISE, RADIUS, OFF = 12, 2e-4, 0.06, 0.004
GROUP = (4, 5, 6, 7)


def corner(rng: np.random.Generator, *, across: bool) -> FloatArray:
    """A floor, a wall along x, one of two walls across x, and six points on the round between floor and second wall."""
    floor = np.column_stack([rng.uniform(-0.44, 0.44, (200, 2)), np.zeros(200)])
    own = np.column_stack([np.full(60, -0.5 if across else 0.5), rng.uniform([-0.5, RADIUS], [0.5, 0.3], (60, 2))])
    common = np.insert(rng.uniform([-0.44, 0.0], [0.44, 0.25], (100, 2)), 1, 0.5, axis=1)
    turn = rng.uniform(0.0, np.pi / 2, 6)
    place = np.array([-0.5, 0.0, 0.0]) + RADIUS * np.column_stack([1 - np.cos(turn), np.zeros(6), 1 - np.sin(turn)])
    place[:, 1] = rng.uniform(-0.5, 0.5, 6)
    points = np.concatenate([floor, own, common, place])
    return points + NOISE * rng.normal(size=points.shape)


def refined(seed: int, *, on_table: bool) -> tuple[PlacedBodies, FloatArray]:
    """A table whose views of one group are begun off along x; what came of it, and how far each scan is off, (n, 6)."""
    rng = np.random.default_rng(seed)
    step = DualQuaternion.from_screw([0.1, 0.3, 1.0], 2 * np.pi / COUNT, 0.0, [0.4, 0.1, 0.0])
    truth = (step ** np.arange(float(COUNT))).as_matrix()
    views = read_views([pose.apply(pose.inverse(truth[k]), corner(rng, across=k in GROUP)) for k in range(COUNT)], 0)
    bodies: list[Body] = [body_of(view, None) for view in views]
    truth = truth @ pose.from_parts(np.eye(3), np.array([view.origin for view in views]))
    begun = truth.copy()
    begun[list(GROUP), 0, 3] += OFF
    table = (range(COUNT), COUNT) if on_table else None
    found = refine_on_planes(bodies, begun, np.arange(1, COUNT), typical_spacing(views), 1.0, table)
    assert found is not None
    assert found.converged
    about = pose.from_parts(np.eye(3), -found.centre)
    return found, pose.log(about @ truth @ pose.inverse(about @ found.T_world_body))


def squared(found: PlacedBodies, off: FloatArray) -> float:
    """Mean squared error of the scans of the group in units of their covariances."""
    rows = [slice(6 * (k - 1), 6 * k) for k in GROUP]
    errors = [off[k] @ np.linalg.solve(found.covariance[r, r], off[k]) for k, r in zip(GROUP, rows, strict=True)]
    return float(np.mean(errors))


@pytest.mark.parametrize("seed", [2, 4])
def test_what_few_points_of_a_round_say_of_a_group_is_not_believed(seed: int) -> None:
    found, off = refined(seed, on_table=False)
    assert squared(found, off) < CHI2_LIMIT
    # As a scan does that nothing holds, it stays.
    assert np.abs(off[list(GROUP), 3]).max() < 1.1 * OFF


@pytest.mark.parametrize("seed", [2, 4])
def test_steps_of_a_table_hold_such_a_group(seed: int) -> None:
    found, off = refined(seed, on_table=True)
    assert found.by_steps
    assert squared(found, off) < CHI2_LIMIT
    assert np.abs(off[:, 3:]).max() < NOISE


def chain(points: IntArray) -> tuple[sparse.csc_matrix, FloatArray, np.ndarray]:
    """Scans each held against the next by so many points in each direction, (6 n, 6 n); lengths; who sees whom."""
    count = len(points) + 1
    links = np.zeros((len(points), count))
    links[range(len(points)), range(len(points))], links[range(len(points)), range(1, count)] = -1.0, 1.0
    matrix = np.kron(links.T @ (points[:, None] * links), np.eye(6))
    return sparse.csc_matrix(matrix), np.tile(np.eye(6), (count, 1, 1)), links.T @ links != 0.0


def counted(points: IntArray) -> tuple[FloatArray, FloatArray]:
    """What counts of increments along such a chain, where ten points are asked, and the matrix of what counts."""
    matrix, lengths, shared = chain(points)
    counts = without_loose_motions(matrix, lengths, shared, 10.0)
    return counts.toarray(), (counts.T @ matrix @ counts).toarray()


def beyond(scan: int, count: int) -> FloatArray:
    """All scans after one moved by one along x."""
    return np.kron(np.arange(count) > scan, np.eye(6)[3])


def test_the_drift_of_a_long_chain_of_well_held_scans_counts() -> None:
    # The ends of it move apart past a fifth of a point.
    counts, _ = counted(np.full(99, 20))
    assert (counts == np.eye(600)).all()


def test_one_weak_link_of_a_chain_lets_go_and_nothing_else_does() -> None:
    points = np.full(40, 300)
    points[15] = 7
    _, held = counted(points)
    assert beyond(15, 41) @ held @ beyond(15, 41) < 1e-6
    for scan in (14, 16):
        np.testing.assert_allclose(beyond(scan, 41) @ held @ beyond(scan, 41), 300.0, rtol=1e-6)


def test_what_all_scans_share_counts_and_a_loose_scan_moves_none_of_the_others() -> None:
    # If not, those that stay would feel the others drift away from them.
    points = np.full(12, 80)
    points[-1] = 1
    counts, _ = counted(points)
    common = np.tile(np.random.default_rng(0).normal(size=6), 13)
    np.testing.assert_allclose(counts @ common, common, atol=1e-4)
    moved = (counts @ beyond(11, 13)).reshape(-1, 6)
    np.testing.assert_allclose(moved, moved[[0]].repeat(13, axis=0), atol=1e-4)
