"""One call against weights, lowered weights and estimator one by one: the same bits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.geometry import CloudSurface, PointCloud, prepare_scan
from dqreg.geometry.cells import Cells, CellSurface
from dqreg.icp import Correspondences, InlierMixture, NormalAngle, WithinDistance, find_correspondences
from dqreg.icp.estimators import CHUNK_PAIRS, Estimator, cells_to_cells, points_to_planes, surfaces_to_surfaces
from dqreg.icp.loop import weighed_step
from dqreg.icp.rejectors import boundary_rejectors
from dqreg.icp.weighing import CHUNK_ROWS, weigh
from tests.icp.scenes import bumpy_cloud, motion

MIXTURE = InlierMixture(scale=0.02, inlier_fraction=0.8, limit=0.3)
LIMITS = WithinDistance(0.2), NormalAngle(np.deg2rad(60.0))


def pairs_of(count: int, kind: str) -> Correspondences:
    """Pairs of two samples of one sheet at a pose that is a little off; a tenth of the scan is far away."""
    points, T = bumpy_cloud(count, 1), motion(0.02, 0.01)
    points[::10] += [0.0, 0.0, 0.5]
    if kind == "from a stand":
        # Denser and denser towards the stand, so that the spread of the spacings asks for the noise of the normals.
        points[:, :2] *= np.geomspace(0.1, 1.0, count)[:, None]
    scan, target = prepare_scan(PointCloud(points)), PointCloud(bumpy_cloud(count, 2))
    if kind != "cells":
        return find_correspondences(scan, CloudSurface(target), T)
    cells = Cells.of(target, 0.05)
    surface = CellSurface(PointCloud(cells.points), cells, cells.planes())
    surface.wide[::3] = surface.has_wide = True
    many = np.random.default_rng(3).integers(1, 9, len(scan)).astype(float)
    return find_correspondences(dataclasses.replace(scan, counts=many, within=0.01 * many), surface, T)


@pytest.mark.parametrize("estimator", [surfaces_to_surfaces, cells_to_cells])
@pytest.mark.parametrize("kind", ["points", "from a stand", "cells"])
# More than one chunk of sums as well.
@pytest.mark.parametrize("count", [300, CHUNK_PAIRS + 500])
def test_one_call_gives_the_bits_of_its_parts(estimator: Estimator, kind: str, count: int) -> None:
    pairs = pairs_of(count, kind)
    rejectors = *LIMITS, *boundary_rejectors(pairs.surface, MIXTURE.scale)
    one, T = weighed_step(pairs, MIXTURE, rejectors, estimator)
    parts = weigh(pairs, MIXTURE, rejectors)
    assert (one.energy, one.total, one.mean_square, one.used) == (
        *(parts.energy, parts.total, parts.mean_square),
        parts.used,
    )
    assert one.weights.tobytes() == parts.weights.tobytes()
    assert 0 < one.used < len(pairs.scan)
    assert T.tobytes() == estimator(pairs, parts.weights, MIXTURE.scale).T_target_source.tobytes()


def test_without_planes_the_step_is_of_points() -> None:
    pairs = pairs_of(300, "points")
    none = dataclasses.replace(pairs.closest, normals=np.zeros((len(pairs.scan), 3)))
    pairs = dataclasses.replace(pairs, closest=none)
    one, T = weighed_step(pairs, MIXTURE, LIMITS, surfaces_to_surfaces)
    np.testing.assert_array_equal(T, surfaces_to_surfaces(pairs, one.weights, MIXTURE.scale).T_target_source)
    few, wide = pairs.taken(np.arange(2)), InlierMixture(1.0, 0.5, 3.0)
    assert weighed_step(few, wide, (WithinDistance(3.0), LIMITS[1]), surfaces_to_surfaces)[1] is None


def test_other_parts_and_many_rows_are_left_to_the_parts() -> None:
    pairs = pairs_of(300, "points")
    assert weighed_step(pairs, MIXTURE, LIMITS, points_to_planes) is None
    assert weighed_step(pairs, MIXTURE, LIMITS[:1], surfaces_to_surfaces) is None
    many = pairs.taken(np.arange(CHUNK_ROWS + 1) % len(pairs.scan))
    assert weighed_step(many, MIXTURE, LIMITS, surfaces_to_surfaces) is None
