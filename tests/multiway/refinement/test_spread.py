"""The covariance of all poses: what the faces hold, and what nothing but edges and rims holds."""

import numpy as np
import pytest

from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.multiway.pose_graph.edges import PART
from dqreg.multiway.refinement.bodies import Body
from dqreg.multiway.refinement.joint import refine_jointly
from dqreg.multiway.refinement.refine import refined
from dqreg.multiway.refinement.spread import WorldCovariance, beyond_noise, joint_covariance, root_of, without_apparent
from dqreg.multiway.scans.scans import read_views
from dqreg.registration.target import prepare_target
from dqreg.rigid import pose
from dqreg.synth.parts import block, bracket

STEP, NOISE = 0.05, 1e-3


def bent_sheet(rng: np.random.Generator) -> np.ndarray:
    """Two faces that meet in the y axis: planes alone let it slide along that axis."""
    u, v = rng.uniform(0.0, 1.0, (2, int(1.0 / STEP**2)))
    o = np.zeros_like(u)
    sheet = np.concatenate([np.stack([u, v, o], axis=1), np.stack([o, v, u], axis=1)])
    return sheet + NOISE * rng.normal(size=sheet.shape)


@pytest.fixture(scope="module")
def spread() -> tuple[np.ndarray, float]:
    rng = np.random.default_rng(0)
    views = read_views([bent_sheet(rng), bent_sheet(rng)], 0)
    bodies = [Body(view.scan, view.surface, view.origin) for view in views]
    T = np.tile(np.eye(4), (2, 1, 1))
    T[:, :3, 3] = [view.origin for view in views]
    free = np.array([1])
    joint = refine_jointly(bodies, T, [(0, 1)], free, 5000)
    T = joint.T_world_body.copy()
    T[:, :3, 3] -= T[:, :3, 3].mean(axis=0)
    return joint_covariance(T, joint.planes, free, 0.2, 1.0).covariance, views[0].scan.spacing


def test_a_motion_that_edges_alone_hold_is_as_sure_as_half_a_spacing(spread: tuple[np.ndarray, float]) -> None:
    covariance, spacing = spread
    along = float(np.sqrt(covariance[4, 4]))
    # Points of one scan come to lie between those of the other, wherever these happen to be.
    assert 0.3 * spacing < along < 1.0 * spacing


def test_a_motion_that_faces_hold_is_as_sure_as_their_points(spread: tuple[np.ndarray, float]) -> None:
    covariance, _ = spread
    across = np.sqrt(np.diag(covariance)[[3, 5]])
    # Two scans of 400 points a face: their means differ by NOISE sqrt(2 / 400) = 7e-5 where all are independent; fitted
    # planes share points, so that it is a few times as much.
    assert ((across > 3e-5) & (across < 6e-4)).all()


def test_information_less_the_apparent_part_of_it() -> None:
    information = np.diag([4.0, 2.0, 1.0, 1e6, 1e4, 1.0])
    apparent = np.diag([1.0, 0.0, 1.0, 0.0, 5e3, 2.0])
    left = without_apparent(information, apparent)
    np.testing.assert_allclose(np.diag(left)[[0, 1, 3, 4]], [3.0, 2.0, 1e6, 5e3], rtol=1e-9)
    # Where errors of normals explain all of it, a little stays: the matrix must have an inverse.
    assert (np.diag(left)[[2, 5]] > 0.0).all()
    assert (np.diag(left)[[2, 5]] < 0.01).all()


def test_signs_of_a_cloud_with_a_viewpoint_are_known() -> None:
    rng = np.random.default_rng(1)
    front = np.column_stack([rng.uniform(0.0, 1.0, (500, 2)), np.zeros(500)])
    views = read_views(
        [PointCloud(front, viewpoint=[0.5, 0.5, 3.0]), PointCloud(front + 1.0, viewpoint=[0, 0, -3.0])], 0
    )
    assert all(view.surface.oriented and view.scan.oriented for view in views)
    assert views[0].surface.normals[:, 2].min() > 0.99
    assert views[1].surface.normals[:, 2].max() < -0.99


def test_nothing_is_known_of_a_scan_that_meets_no_other() -> None:
    rng = np.random.default_rng(4)
    views = read_views([bent_sheet(rng), bent_sheet(rng), bent_sheet(rng) + 10.0], 0)
    bodies = [Body(view.scan, view.surface, view.origin) for view in views]
    T = np.stack([pose.from_parts(np.eye(3), view.origin) for view in views])
    free = np.array([1, 2])
    joint = refine_jointly(bodies, T, [(0, 1), (1, 2)], free, 5000)
    covariance = joint_covariance(joint.T_world_body, joint.planes, free, 0.2, 1.0).covariance
    assert np.isfinite(covariance[:6, :6]).all()
    assert np.isnan(np.diag(covariance)[6:]).all()


@pytest.mark.parametrize("points", [60, 100])
def test_scans_too_sparse_for_planes_have_a_covariance_or_none(points: int) -> None:
    # With half of the reach they meet nowhere.
    part = Mesh(*block())
    for seed in range(4):
        rng = np.random.default_rng(seed)
        views = read_views([sample_mesh(part, points, rng).points for _ in range(3)], 0)
        bodies = [Body(view.scan, view.surface, view.origin) for view in views]
        found = refined(views, bodies, None, np.tile(np.eye(4), (3, 1, 1)), 0, part.diagonal, "fast")
        variances = np.diag(found.covariance)[6:]
        assert (np.isnan(variances) | (variances > 0.0)).all()


def test_a_root_has_no_negative_variances() -> None:
    # All but singular, as where all scans together may move by far more than apart.
    rng = np.random.default_rng(2)
    tall = rng.normal(size=(12, 12)) @ np.diag(np.logspace(0.0, -9.0, 12))
    matrix = tall @ tall.T
    assert np.linalg.eigvalsh(matrix)[0] < 0.0
    root = root_of(matrix)
    np.testing.assert_allclose(root @ root.T, matrix, atol=1e-13 * np.abs(matrix).max())


def test_of_a_change_what_noise_explains_is_no_error_and_the_rest_is() -> None:
    rng = np.random.default_rng(3)
    influences = rng.normal(size=(6, 50))
    none = WorldCovariance(np.eye(6), np.arange(50), np.zeros((6, 50)))
    spread = WorldCovariance(np.eye(6), np.arange(50), influences)
    root = np.linalg.cholesky(influences @ influences.T)
    changes = (root @ rng.normal(size=(6, 400))).T
    left = np.array([beyond_noise(change[None], spread, none)[0] for change in changes])
    share = np.linalg.norm(np.linalg.solve(root, left.T)) ** 2 / (6.0 * len(changes))
    # A fourth of it, where all of it was taken for an error before.
    assert share < 0.3
    far = 20.0 * root[:, :1].T
    np.testing.assert_allclose(beyond_noise(far, spread, none), far, rtol=0.01)


def test_squared_errors_of_scans_on_a_part_are_those_that_covariances_say() -> None:
    # Of the points half lie near edges; they hold the poses too, as the planes of a part are exact.
    part, errors = Mesh(*bracket()), []
    target, noise = prepare_target(part), 1e-3 * part.diagonal
    for seed in range(6):
        rng, points = np.random.default_rng(seed), []
        for turn in 2.0 * np.pi * np.arange(3) / 3.0:
            side = np.array([np.cos(turn), np.sin(turn), 0.5])
            drawn = sample_mesh(part, 2500, rng)
            seen = drawn.points[drawn.normals @ side > -0.35]
            points.append(seen + noise * rng.normal(size=seen.shape))
        views = read_views(points, 0)
        bodies = [Body(view.scan, view.surface, view.origin) for view in views]
        found = refined(views, bodies, target, np.tile(np.eye(4), (3, 1, 1)), PART, part.diagonal, "fast")
        about = pose.from_parts(np.eye(3), found.centre)
        error = pose.log(pose.inverse(about) @ found.T_world_scan @ about)
        blocks = np.einsum("kikj->kij", found.covariance.reshape(3, 6, 3, 6))
        errors += [error[k] @ np.linalg.solve(blocks[k], error[k]) / 6.0 for k in range(3)]
    assert 0.8 < np.mean(errors) < 1.5
