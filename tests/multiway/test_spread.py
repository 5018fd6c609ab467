"""The covariance of all poses: what the faces hold, and what nothing but edges and rims holds."""

import numpy as np
import pytest

from dqreg.geometry import PointCloud
from dqreg.multiway.bodies import Body
from dqreg.multiway.joint import refine_jointly
from dqreg.multiway.scans import read_views
from dqreg.multiway.spread import joint_covariance, less

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
    return joint_covariance(T, joint.planes, free, 0.2, 1.0), views[0].scan.spacing


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
    left = less(information, apparent)
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
