from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh
from dqreg.geometry.morton import morton_order
from dqreg.geometry.sampling import sample_mesh
from dqreg.rigid import pose, twist
from dqreg.solvers.sandwich import MIN_NOISE_SHARE, _Patches, scatter_of, with_known
from dqreg.synth import parts
from dqreg.trust import Information, without_free_motion
from tests.trust.shapes import box, judged, plane

POINTS, SIGMA = 8_000, 1e-3


def shape() -> tuple[FloatArray, FloatArray, FloatArray]:
    points, normals = box(np.random.default_rng(0), POINTS)
    order = morton_order(points)
    points, normals = points[order], normals[order]
    return points, normals, np.vstack([np.cross(points, normals).T, normals.T])


def errors_of(draws: int, side: float | None, spread: FloatArray | float = 1.0) -> FloatArray:
    """Squared errors in units of the claimed covariance, six on average; the fits themselves, no loop in between.

    Noise is independent, or one vector for each cube of space of the given side.
    """
    points, normals, rows = shape()
    inverse = np.linalg.pinv(rows)
    found = []
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        if side is None:
            noise = SIGMA * spread * rng.normal(size=POINTS)
        else:
            _, cubes = np.unique(np.floor(points / side + rng.uniform(size=3)).astype(int), axis=0, return_inverse=True)
            noise = np.einsum("ij,ij->i", normals, SIGMA * rng.normal(size=(cubes.max() + 1, 3))[cubes.ravel()])
        fit = noise @ inverse
        C = scatter_of(rows, points, normals, noise - fit @ rows, np.ones(POINTS), np.zeros((6, 6)), SIGMA**2)
        assert C is not None
        found.append(fit @ np.linalg.solve(C, fit))
    return np.array(found)


@pytest.mark.parametrize("uneven", [False, True])
def test_independent_noise_is_seen_as_it_is(uneven: bool) -> None:
    # 80 draws with a variance of 12 and more: the mean is good to 0.4; faces may scatter differently.
    spread = np.where(shape()[1].sum(axis=1) > 0.0, 1.0, 0.2) if uneven else 1.0
    assert errors_of(80, None, spread).mean() == pytest.approx(6.0, abs=1.5)


@pytest.mark.parametrize("count", [240, 600])
def test_few_points_are_not_claimed_to_be_surer_than_they_are(count: int) -> None:
    """A plate, whose sides few points show: 30 and 75 patches, of which some alone hold a motion."""
    claimed = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        scan = sample_mesh(Mesh(*parts.box((1.0, 0.8, 0.1))), count, rng)
        assert scan.normals is not None
        order = morton_order(scan.points)
        points, normals = scan.points[order], scan.normals[order]
        rows, noise = np.vstack([np.cross(points, normals).T, normals.T]), rng.normal(size=count)
        fit = noise @ np.linalg.pinv(rows)
        left = noise - fit @ rows
        C = scatter_of(rows, points, normals, left, np.ones(count), np.zeros((6, 6)), left @ left / (count - 6.0))
        assert C is not None
        claimed.append(fit @ np.linalg.solve(C, fit))
    # Six on average of a covariance that is right, good to 0.25 of 200 draws; patches alone came to 10 of 240 points.
    assert 4.5 < np.mean(claimed) < 6.7


def test_noise_that_hundreds_of_neighbours_share_is_seen() -> None:
    # 22 units of area in squares of side 0.4: about 60 points a cube face, 200 cubes. Patches of 40 points alone claim
    # a mean of about 18 here, residuals taken for errors 8.6; what is left over is the scatter of what can be learned
    # from 200 values. 60 draws: good to 0.7.
    assert errors_of(60, 0.4).mean() < 8.5


def test_the_claim_never_falls_below_that_of_the_patches_alone() -> None:
    points, normals, rows = shape()
    noise = SIGMA * np.random.default_rng(0).normal(size=POINTS)
    even = scatter_of(rows, points, normals, noise, np.ones(POINTS), np.zeros((6, 6)), SIGMA**2)
    shared = np.repeat(noise[:: POINTS // 100], POINTS // 100)
    wide = scatter_of(rows, points, normals, shared, np.ones(POINTS), np.zeros((6, 6)), SIGMA**2)
    assert even is not None
    assert wide is not None
    assert np.trace(wide) > 10.0 * np.trace(even)
    for C in (even, wide):
        np.testing.assert_allclose(C, C.T, rtol=1e-9)
        assert np.linalg.eigvalsh(C).min() > 0.0


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_lengths_scale_with_the_unit(factor: float) -> None:
    points, normals, rows = shape()
    rng = np.random.default_rng(1)
    noise = np.repeat(rng.normal(size=POINTS // 80), 80) + 0.1 * rng.normal(size=POINTS)
    plain = scatter_of(rows, points, normals, noise, np.ones(POINTS), np.zeros((6, 6)), 1.0)
    # Rows are in levers, so that only the noise carries the unit.
    scaled = scatter_of(rows, factor * points, normals, factor * noise, np.ones(POINTS), np.zeros((6, 6)), factor**2)
    assert plain is not None
    assert scaled is not None
    np.testing.assert_allclose(scaled, factor**2 * plain, rtol=1e-6)


def test_too_few_pairs_and_pairs_at_one_place() -> None:
    points, normals, rows = shape()
    few = slice(0, 200)
    assert scatter_of(rows[:, few], points[few], normals[few], np.ones(200), np.ones(200), np.eye(6), 1.0) is None
    noise = np.repeat(np.random.default_rng(0).normal(size=100), 80)
    found = scatter_of(rows, np.zeros_like(points), normals, noise, np.ones(POINTS), np.zeros((6, 6)), 1.0)
    assert found is not None
    assert np.isfinite(found).all()


def test_as_many_unknowns_as_patches_have_no_scatter() -> None:
    rng, count = np.random.default_rng(4), 8 * 31
    points, known = rng.normal(size=(count, 3)), np.eye(30)
    rows, weights = rng.normal(size=(30, count)), np.ones(count)
    assert scatter_of(rows, points, points, rng.normal(size=count), weights, known, 1.0) is None


def test_free_motions_are_taken_back_and_the_others_kept() -> None:
    points, normals = plane(np.random.default_rng(0))
    held: Information = judged(points, normals)
    start = twist.exp([0.0, 0.0, 0.3, 1.0, -2.0, 0.0])
    found = twist.exp([0.02, -0.01, 0.0, 0.0, 0.0, 0.5]) @ twist.exp([0.0, 0.0, -0.2, 0.4, 0.1, 0.0]) @ start
    back = twist.log(without_free_motion(found, start, held) @ pose.inverse(start))
    np.testing.assert_allclose(back[[2, 3, 4]], 0.0, atol=1e-9)
    # Whatever is taken back lies in the plane: no point is nearer to it, or farther, than before.
    heights = (pose.apply(T, points)[:, 2] for T in (found, without_free_motion(found, start, held)))
    np.testing.assert_allclose(*heights, atol=1e-12)
    everything = all_held(held)
    np.testing.assert_array_equal(without_free_motion(found, start, everything), found)


def all_held(information: Information) -> Information:
    return Information(np.ones(6), information.vectors, 1.0, 1.0, information.lever, information.centre)


def test_outliers_without_weight_are_no_noise_that_neighbours_share() -> None:
    # Beyond the overlap of two scans, and on a table, whole patches have no weight, and residuals as large as the part.
    points, normals, rows = shape()
    noise = SIGMA * np.random.default_rng(1).normal(size=POINTS)
    off = points[:, 0] > np.quantile(points[:, 0], 0.7)
    residuals, weights = np.where(off, 1.0, noise), np.where(off, 1e-12, 1.0)
    C = scatter_of(rows, points, normals, residuals, weights, np.zeros((6, 6)), SIGMA**2)
    alone = scatter_of(
        rows[:, ~off], points[~off], normals[~off], noise[~off], weights[~off], np.zeros((6, 6)), SIGMA**2
    )
    assert C is not None
    assert alone is not None
    np.testing.assert_array_less(np.diag(C), 4.0 * np.diag(alone))


@pytest.mark.parametrize("count", [50, 207])
def test_what_shared_noise_adds_and_leaves_are_products_of_matrices(count: int) -> None:
    rng = np.random.default_rng(7)
    points, normals, along, pulls = (
        rng.normal(size=shape) for shape in ((count, 3), (count, 3), (count, 3, 4), (count, 4))
    )
    weights, half = rng.uniform(0.5, 1.0, count), rng.normal(size=(4, 4))
    bread = half @ half.T / count
    h = np.minimum(np.linalg.norm(points[:, None] - points, axis=2) / 1.3, 1.0)
    shared = 2.0 * (1.0 - 1.5 * h + 0.5 * h**3) * ~np.eye(count, dtype=bool)
    found, left = _Patches(points, normals, rng.normal(size=count), weights, 1.0, 0.0).between_and_left(
        2.0, 1.3, pulls, along, bread
    )
    np.testing.assert_allclose(found, sum(p.T @ shared @ p for p in along.transpose(1, 0, 2)), rtol=0, atol=1e-10)
    meant, hat = shared * (normals @ normals.T), (pulls.T / weights).T @ bread @ pulls.T
    residual = (np.eye(count) - hat) @ meant @ (np.eye(count) - hat).T
    expected = float(np.vdot(residual, meant)) / float(np.vdot(meant, meant))
    assert left == pytest.approx(max(expected, MIN_NOISE_SHARE), abs=1e-10)


def test_no_less_is_known_than_was_beforehand_and_no_more_where_that_is_less() -> None:
    rng = np.random.default_rng(11)
    for rank in (0, 2, 4):
        half, rows = rng.normal(size=(4, 4)), rng.normal(size=(rank, 4))
        scatter, known = half @ half.T, rows.T @ rows
        found = with_known(scatter, known)
        after = np.linalg.inv(found)
        for least in (np.linalg.inv(scatter), known):
            beyond = np.linalg.eigvalsh(after - least)
            assert beyond[0] > -1e-9 * beyond[-1] - 1e-9
        # In axes where one is the identity and the other diagonal, the larger of both informations.
        shares = np.linalg.eigvals(scatter @ known).real
        smaller = float(np.linalg.det(scatter) / np.linalg.det(found))
        assert smaller == pytest.approx(float(np.prod(np.maximum(shares, 1.0))))
    np.testing.assert_array_equal(with_known(np.zeros((4, 4)), np.eye(4)), np.zeros((4, 4)))
