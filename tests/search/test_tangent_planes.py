"""Near symmetries of a cloud, asked of the planes between its points."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import CloudSurface, Mesh, PointCloud, sample_mesh
from dqreg.rigid import pose
from dqreg.search.near_symmetry import near_flips
from dqreg.search.periods import near_periods
from dqreg.search.tangent_planes import TangentPlanes
from dqreg.synth.parts import box
from tests.search.periodic import joined, stairs

EDGES = (90.0, 60.0, 40.0)
HALF_TURN = pose.from_parts(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))


def cloud_of(mesh: Mesh) -> TangentPlanes:
    rng = np.random.default_rng(0)
    points = sample_mesh(mesh, 6_000, rng).points
    return TangentPlanes(CloudSurface(PointCloud(points + 3e-4 * mesh.diagonal * rng.normal(size=points.shape))))


def test_a_cloud_of_stairs_has_their_period() -> None:
    part = stairs(6, 24.0, 14.0)
    planes = cloud_of(part)
    found = near_periods(planes.facets(), planes, 600)
    assert np.linalg.norm(found[:, :3, 3] - [24.0, 0.0, 14.0], axis=1).min() <= 5e-3 * part.diagonal


@pytest.mark.parametrize("knob", [0.0, 6.0])
def test_a_block_is_symmetric_and_one_with_a_knob_nearly(knob: float) -> None:
    middles = [(0.0, 0.0, 0.0), (30.0, 18.0, 20.0)]
    part = joined([EDGES, (knob, knob, 2.0 * knob)], middles) if knob else Mesh(*box(EDGES))
    planes = cloud_of(part)
    flips = near_flips(planes.facets(), planes)
    angles = np.trace(flips[:, :3, :3], axis1=1, axis2=2)
    assert len(flips) == 3
    assert angles == pytest.approx(-np.ones(3), abs=1e-2)
    assert planes.is_symmetry(HALF_TURN) == (knob == 0.0)


def test_a_block_is_no_other_one_on_its_side() -> None:
    planes = cloud_of(Mesh(*box((90.0, 88.0, 40.0))))
    assert planes.is_symmetry(HALF_TURN)
    assert not planes.is_symmetry(
        pose.from_parts(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))
    )


def test_what_is_within_a_distance_is_found_as_without_it_and_nothing_else_seems_nearer() -> None:
    planes = cloud_of(Mesh(*box(EDGES)))
    rng = np.random.default_rng(1)
    points = rng.uniform(-60.0, 60.0, (3_000, 3))
    for within in (0.5, 3.0, 20.0):
        some, whole = planes.closest(points, within=within), planes.closest(points)
        is_near = whole.distances <= within
        assert 0 < np.count_nonzero(is_near) < len(points)
        for name in ("points", "normals", "distances", "elements"):
            np.testing.assert_array_equal(getattr(some, name)[is_near], getattr(whole, name)[is_near])
        assert (some.distances[~is_near] >= within).all()
