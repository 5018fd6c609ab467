"""Planes that several scans share: what thin faces hold, what no face holds, and the normal equations behind them."""

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.kernels.steps.plane_elimination import BEFOREHAND, eliminate_planes
from dqreg.multiway.refinement.bodies import Body
from dqreg.multiway.refinement.common_planes import PAIR_SIGMA_SPACINGS, PlacedBodies, refine_on_planes
from dqreg.multiway.scans.scans import read_views, typical_spacing
from dqreg.multiway.visibility.sides import body_of
from dqreg.rigid import pose

SCANS, POINTS, NOISE, OFF = 6, 500, 1e-4, 0.01
FREE = np.arange(1, SCANS)


def scan(rng: np.random.Generator, *, walls: bool) -> FloatArray:
    """A floor, and on it two walls lower than the spacing of the points of one scan."""
    floor = np.column_stack([rng.uniform(-0.5, 0.5, (POINTS, 2)), np.zeros(POINTS)])
    along, up = rng.uniform(-0.5, 0.5, (2, POINTS // 5)), rng.uniform(0.0, 0.04, (2, POINTS // 5))
    half = np.full(POINTS // 5, 0.5)
    found = [floor, np.column_stack([half, along[0], up[0]]), np.column_stack([along[1], half, up[1]])]
    points = np.concatenate(found if walls else found[:1])
    return points + NOISE * rng.normal(size=points.shape)


def refined(*, walls: bool, noise: float = 0.0) -> tuple[PlacedBodies | None, FloatArray, float]:
    """Scans displaced along the floor: their poses, how far they are from the truth, (n, 3), and the spacing."""
    rng = np.random.default_rng(5)
    points = [scan(rng, walls=walls) for _ in range(SCANS)]
    views = read_views([p + noise * rng.normal(size=p.shape) for p in points], 0)
    bodies: list[Body] = [body_of(view, None) for view in views]
    truth = np.stack([pose.from_parts(np.eye(3), view.origin) for view in views])
    begun = truth.copy()
    begun[1:, :2, 3] += rng.choice([-OFF, OFF], size=(SCANS - 1, 2))
    spacing = typical_spacing(views)
    found = refine_on_planes(bodies, begun, FREE, spacing, 1.0)
    off = np.zeros((SCANS, 3)) if found is None else (found.T_world_body - truth)[:, :3, 3]
    return found, off, spacing


def test_walls_lower_than_the_spacing_hold_scans_to_the_noise() -> None:
    found, off, spacing = refined(walls=True)
    assert found is not None
    assert found.converged
    # A hundred times the noise at first, and a third of the spacing.
    assert np.abs(off).max() < NOISE < 0.01 * spacing
    errors = np.array([off[k] @ np.linalg.solve(_of(found, k), off[k]) for k in FREE])
    # Three degrees of freedom each; the scans share the error of the first.
    assert 1.0 < errors.mean() < 8.0


def test_what_no_face_holds_stays_and_is_told() -> None:
    found, off, spacing = refined(walls=False)
    assert found is not None
    assert np.abs(off[:, 2]).max() < NOISE
    assert np.abs(off[1:, :2]).min() > 0.9 * OFF
    for k in FREE:
        # Against the anchor, of which faces hold as little.
        np.testing.assert_allclose(
            np.sqrt(np.diag(_of(found, k))[:2]), np.sqrt(2.0) * PAIR_SIGMA_SPACINGS * spacing, rtol=0.1
        )


def test_one_row_along_a_rim_holds_nothing() -> None:
    # The last scan sees two walls, and the wall of a hole in the floor by one row of points below its rim. What bends
    # in its own plane has the normal of a floor, next to one.
    rng, depth, radius, count = np.random.default_rng(2), 0.01, 0.2, 5
    angles = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    row = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(60, -depth)])
    scans = []
    for k in range(count):
        a, b = rng.uniform([-0.5, 0.0], [0.5, 0.5], (2, 300, 2))
        walls = [np.insert(a, 0, 0.5, axis=1), np.insert(b, 1, 0.5, axis=1)]
        floor = np.column_stack([rng.uniform(-0.5, 0.5, (POINTS, 2)), np.zeros(POINTS)])
        below = row if k == count - 1 else floor[np.linalg.norm(floor, axis=1) > radius]
        points = np.concatenate([*walls, below])
        scans.append(points + NOISE * rng.normal(size=points.shape))
    views = read_views(scans, 0)
    truth = np.stack([pose.from_parts(np.eye(3), view.origin) for view in views])
    found = refine_on_planes([body_of(v, None) for v in views], truth, FREE[: count - 1], typical_spacing(views), 1.0)
    assert found is not None
    off = (found.T_world_body - truth)[-1, :3, 3]
    assert np.abs(off[:2]).max() < 3.0 * NOISE
    # Nothing but where it began tells its height.
    assert abs(off[2]) < np.sqrt(_of(found, count - 1)[2, 2])


def test_noise_as_large_as_the_spacing_is_left_to_pairs() -> None:
    assert refined(walls=True, noise=0.02)[0] is None


def _of(found: PlacedBodies, k: int) -> FloatArray:
    place = 6 * (k - 1) + np.arange(3, 6)
    return found.covariance[np.ix_(place, place)]


@pytest.mark.parametrize("seed", [0, 1])
def test_the_matrix_is_that_of_least_squares_with_the_planes_unknown(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scans, variance = np.array([0, 2, 0, 1, 2]), 0.3
    starts, count = np.array([0, 2, 5]), 9
    planes = [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2)]
    of = np.array([0, 0, 1, 1, 1])
    points = [(planes[f][:, :2] @ rng.normal(size=(2, count))).T + planes[f][:, 2] for f in of]
    rows = [np.column_stack([p, np.ones(count)]) for p in points]
    moments = np.array([r.T @ r for r in rows])
    table = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    blocks, slopes = np.zeros((6, 6, 6)), np.zeros((5, 6))
    eliminate_planes(starts, scans, moments, variance, table, blocks, slopes)
    matrix = np.zeros((18, 18))
    for i in range(3):
        for j in range(i, 3):
            matrix[6 * i : 6 * i + 6, 6 * j : 6 * j + 6] = blocks[table[i, j]]
    matrix = np.triu(matrix) + np.triu(matrix, 1).T
    increments, expected = rng.normal(size=18), 0.0
    for f in range(2):
        mine = np.flatnonzero(of == f)
        x, n = np.concatenate([points[g] for g in mine]), planes[f][:, 2]
        each = np.repeat(increments.reshape(3, 6)[scans[mine]], count, axis=0)
        change = np.einsum("ij,ij->i", np.cross(x, n), each[:, :3]) + each[:, 3:] @ n
        numbers = np.column_stack([x @ planes[f][:, :2], np.ones(len(x))])
        left = change - numbers @ np.linalg.lstsq(numbers, change, rcond=None)[0]
        expected += (BEFOREHAND + len(x) - 3.0) / (BEFOREHAND * variance) * (left @ left)
    np.testing.assert_allclose(increments @ matrix @ increments, expected, rtol=1e-9)
    np.testing.assert_allclose(slopes, 0.0, atol=1e-9)
