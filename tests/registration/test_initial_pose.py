"""No last digits: a search from nothing gives one answer, however its points are rounded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dqreg
from dqreg.compare.trust.kinds import KINDS
from dqreg.geometry import Mesh
from dqreg.geometry.opening import open_geometry
from dqreg.synth.truth import displacements

# Of the size of the target: 1.5e-5 of 100, as a scan in mm is written; and how far apart answers may be.
GRID, ONE = 1.5e-7, 1e-3


def rounded(points, grid: float, rng: np.random.Generator):
    """Points on a grid that lies at random."""
    corner = grid * rng.uniform(size=3)
    return np.round((points + corner) / grid) * grid - corner


def one_answer(source, target, count: int) -> None:
    points = target.vertices if isinstance(target, Mesh) else target.points
    size, rng = np.linalg.norm(np.ptp(points, axis=0)), np.random.default_rng(0)
    first = dqreg.register(source, target, effort="fast")
    for _ in range(count):
        again = dqreg.register(rounded(source, GRID * size, rng), target, effort="fast")
        assert again.verdict.codes == first.verdict.codes
        assert displacements(again.T_target_source, first.T_target_source, points[::50]).max() < ONE * size


@pytest.mark.parametrize(
    ("seed", "count"), [(0, 1), *(pytest.param(seed, 20, marks=pytest.mark.soak) for seed in range(1, 6))]
)
def test_a_part_in_clutter_is_found_alike_however_the_scan_is_rounded(seed: int, count: int) -> None:
    task = KINDS["on-a-table"].task(seed)
    one_answer(task.source, task.target, count)


@pytest.mark.soak
@pytest.mark.real
@pytest.mark.parametrize(
    ("source", "target"),
    [
        ("weld_tee_scan_cad/table_8in10in_tee_x4y24_45.pcd", "weld_tee_scan_cad/tee_nominal.stl"),
        ("pcl_milk_scene/milk.pcd", "pcl_milk_scene/milk_cartoon_all_small_clorox.pcd"),
        ("redkitchen_fragments/cloud_bin_4.ply", "redkitchen_fragments/cloud_bin_0.ply"),
    ],
    ids=["weld", "milk", "kitchen"],
)
def test_a_real_scene_gives_one_answer_however_it_is_rounded(real_data: Path, source: str, target: str) -> None:
    one_answer(open_geometry(real_data / source, "source").points, open_geometry(real_data / target, "target"), 20)
