from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import width_floor
from dqreg.rigid import pose
from dqreg.search.mirrors import gain_of_mirror, near_mirrors
from dqreg.synth.parts import box, bracket
from dqreg.trust.verdict import MIRRORED

PART = Mesh(*bracket())
SURFACE = MeshSurface(PART)
TWIN = Mesh(PART.vertices * [-1.0, 1.0, 1.0], PART.faces[:, ::-1])


def gain(mesh: Mesh, seed: int) -> float:
    # Truth: the samples lie on the part or on its twin, which the first mirror brings nearest to the part; noise of
    # 3e-4 sizes, and a pose that is off by as much as a registration may be.
    rng = np.random.default_rng(seed)
    points = sample_mesh(mesh, 6_000, rng).points
    if mesh is TWIN:
        flip = near_mirrors(PART, SURFACE)[0] @ np.diag([-1.0, 1.0, 1.0, 1.0])
        points = pose.apply(flip, points)
    scan = prepare_scan(PointCloud(points + 3e-4 * PART.diagonal * rng.normal(size=points.shape)))
    T = pose.from_parts(np.eye(3), 1e-4 * PART.diagonal * rng.normal(size=3))
    return gain_of_mirror(
        T, near_mirrors(PART, SURFACE), scan, SURFACE, 0.05 * PART.diagonal, width_floor(scan, SURFACE)
    )


def test_a_near_mirror_has_determinant_minus_one_and_moves_little():
    (mirror,) = near_mirrors(PART, SURFACE)
    assert np.linalg.det(mirror[:3, :3]) == pytest.approx(-1.0, abs=1e-12)
    sample = sample_mesh(PART, 4_000, np.random.default_rng(0)).points
    off = SURFACE.closest(pose.apply(mirror, sample)).distances
    assert 0.7 < np.mean(off < 5e-3 * PART.diagonal) < 0.998


@pytest.mark.parametrize("shape", [box((3.0, 2.0, 1.0)), box((2.0, 2.0, 2.0))])
def test_what_is_its_own_mirror_image_has_no_twin(shape):
    mesh = Mesh(*shape)
    assert len(near_mirrors(mesh, MeshSurface(mesh))) == 0


def test_without_a_mirror_nothing_is_gained():
    scan = prepare_scan(PointCloud(sample_mesh(PART, 1_000, np.random.default_rng(0)).points))
    assert gain_of_mirror(np.eye(4), np.zeros((0, 4, 4)), scan, SURFACE, 1.0, 1e-3) == -np.inf


@pytest.mark.parametrize("seed", range(3))
def test_the_twin_gains_in_the_mirror_and_the_part_loses(seed):
    # A tenth of the bracket's surface is the difference: far from the limit on either side.
    assert gain(TWIN, seed) > 10.0 * MIRRORED
    assert gain(PART, seed) < -10.0 * MIRRORED
