"""One cloud of all scans: both sides of a sheet stay, and what other scanners looked through does not."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import PointCloud
from dqreg.multiway.scans.merge import fused, merged
from dqreg.multiway.scans.scans import View, read_views
from dqreg.rigid import pose
from dqreg.synth.many_views import ManyViews, turntable_views
from dqreg.synth.parts import bracket

THICKNESS = 1.0
PLACES = np.array([[50.0, 30.0, 500.0], [50.0, 30.0, -500.0]])
AT_HOME = np.array([np.eye(4)] * 2)


def side(height: float, rng: np.random.Generator) -> FloatArray:
    points = rng.uniform(0.0, 1.0, (12_000, 3)) * [100.0, 60.0, 0.0]
    return np.asarray(points + np.outer(rng.normal(height, 0.02, len(points)), [0.0, 0.0, 1.0]))


def sheet(viewpoints: FloatArray | None) -> tuple[View, ...]:
    rng = np.random.default_rng(73_600)
    return read_views([side(THICKNESS, rng), side(0.0, rng)], 0, viewpoints)


@pytest.mark.parametrize("voxel", [None, 1.5, 3.0])
def test_no_point_lies_in_the_metal_of_a_sheet(voxel: float | None) -> None:
    cloud = merged(sheet(PLACES), AT_HOME, voxel)
    heights = cloud.points[:, 2]
    assert not ((heights > 0.1 * THICKNESS) & (heights < 0.9 * THICKNESS)).any()
    assert cloud.normals is not None
    assert np.array_equal(cloud.normals[:, 2] > 0.0, heights > 0.5 * THICKNESS)


def test_cells_at_an_edge_do_not_round_it() -> None:
    rng = np.random.default_rng(73_601)
    flat = rng.uniform(0.0, 1.0, (8_000, 3)) * [1.0, 1.0, 0.0]
    upright = rng.uniform(0.0, 1.0, (8_000, 3)) * [0.0, 1.0, -1.0]
    normals = np.repeat([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]], 8_000, axis=0)
    view = PointCloud(np.concatenate([flat, upright]), normals)
    points = merged(read_views([view, PointCloud(view.points[::2], normals[::2])], 0), AT_HOME, 0.1).points
    assert np.minimum(np.abs(points[:, 0]), np.abs(points[:, 2])).max() < 1e-6


def turned() -> ManyViews:
    return turntable_views(bracket(), 6, pixels=60, rng=np.random.default_rng(73_602))


def hand(made: ManyViews) -> FloatArray:
    """Something before the part, in the first scan alone."""
    middle = made.scans[0].mean(axis=0)
    size = float(np.linalg.norm(np.ptp(made.scans[0], axis=0)))
    sight = (made.viewpoints[0] - middle) / np.linalg.norm(made.viewpoints[0] - middle)
    return np.asarray(middle + 0.1 * size * sight + 0.02 * size * np.random.default_rng(0).normal(size=(60, 3)))


def test_what_other_scanners_looked_through_is_left_out_and_counted() -> None:
    made = turned()
    strays, size = hand(made), float(np.linalg.norm(np.ptp(made.scans[0], axis=0)))
    views = read_views([np.concatenate([made.scans[0], strays]), *made.scans[1:]], 0)
    cloud, left_out = fused(views, made.T_world_scan, None, made.viewpoints)
    place = pose.apply(made.T_world_scan[0], strays.mean(axis=0)[None])
    assert left_out > 0.8 * len(strays)
    assert np.count_nonzero(np.linalg.norm(cloud.points - place, axis=1) < 0.02 * size) < 0.2 * len(strays)


def test_scans_of_the_part_alone_stay_whole() -> None:
    made = turned()
    assert fused(read_views(list(made.scans), 0), made.T_world_scan, None, made.viewpoints)[1] == 0
