"""What the normals of two dense noisy clouds say at a pose: of points, of cells, and those that were given."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from dqreg.geometry import CloudSurface, PointCloud, Scan, prepare_scan, sample_mesh
from dqreg.icp import Alignment, InlierMixture, find_correspondences
from dqreg.registration.evidence.evidence import agreement_of
from dqreg.rigid import pose
from dqreg.rigid.rotations import about_axis
from dqreg.trust.limits import DISAGREEING_NORMAL_SHARE
from tests.icp.scenes import bracket_mesh

PART = bracket_mesh()
SIZE = PART.diagonal
NOISE = 2e-3 * SIZE


def cloud(seed: int, *, given: bool = False) -> PointCloud:
    """Points of all faces, with noise of half their spacing; given normals are turned at random."""
    rng = np.random.default_rng(seed)
    points = sample_mesh(PART, 60_000, rng).points
    normals = rng.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return PointCloud(points + NOISE * rng.normal(size=points.shape), normals=normals if given else None)


@cache
def scan_of(given: bool) -> Scan:
    return prepare_scan(cloud(0, given=given), 2_000)


@cache
def surface_of(given: bool) -> CloudSurface:
    return CloudSurface(cloud(1, given=given))


def normals_apart(T: np.ndarray, given_of: str = "none") -> float:
    """At a pose, with normals given of one side or of none."""
    scan, surface = scan_of(given_of == "source"), surface_of(given_of == "target")
    pairs = find_correspondences(scan, surface, T)
    mixture = InlierMixture(NOISE, 0.9, 0.2 * SIZE)
    run = Alignment(pairs.T_target_source, "converged", (), pairs, mixture.weight(pairs.distances), mixture=mixture)
    given = given_of != "none"
    return agreement_of(run, scan, surface, 0.2 * SIZE, given_normals=given).normals_apart


def test_faces_on_each_other_agree() -> None:
    # The clouds are made in the part's frame: the truth is the identity.
    assert normals_apart(np.eye(4)) < 0.01


@pytest.mark.parametrize("angle_deg", [25.0, 50.0])
def test_faces_that_cross_do_not(angle_deg: float) -> None:
    # About an axis that is parallel to no face, through the middle.
    axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    turn = pose.about(pose.from_parts(about_axis(axis, np.deg2rad(angle_deg)), np.zeros(3)), PART.centre)
    assert normals_apart(turn) > DISAGREEING_NORMAL_SHARE


@pytest.mark.parametrize("side", ["source", "target"])
def test_normals_that_were_given_stay_witnesses(side: str) -> None:
    assert normals_apart(np.eye(4), side) > DISAGREEING_NORMAL_SHARE
