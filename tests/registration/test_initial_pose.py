"""No last digits: a search from nothing gives one answer, however its points are rounded; and it leaves time for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dqreg
from dqreg.compare.trust.kinds import KINDS
from dqreg.geometry import Mesh
from dqreg.geometry.opening import as_geometry
from dqreg.kernels.threads import TimeUpError, until
from dqreg.registration.initial_pose import AFTER, HALF, PAIRS, GlobalSearch
from dqreg.synth.truth import displacements
from tests.icp.scenes import bracket_mesh, bracket_points
from tests.registration.scenes import problem_of

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
    one_answer(as_geometry(real_data / source, "source").points, as_geometry(real_data / target, "target"), 20)


@pytest.mark.parametrize(("limit", "preparing"), [(100.0, 3.0), (100.0, 80.0), (None, 3.0)])
def test_a_search_leaves_time_for_the_loop_and_the_verdict(limit: float | None, preparing: float) -> None:
    problem = problem_of(bracket_points(40, seed=0), bracket_mesh(), time_limit=limit)
    problem.watch.seconds["prepare"] = preparing
    found = GlobalSearch.of(problem, problem.prepare()).time_limit
    if limit is None:
        assert found is None
        return
    # Preparing and asking takes a part of the limit itself, far less than half of it.
    least = max(limit - AFTER * preparing, HALF * limit)
    assert HALF * least < found <= least


@pytest.mark.parametrize("is_prepared", [False, True])
def test_what_searches_look_up_on_a_prepared_target_is_made_whatever_the_time(is_prepared: bool) -> None:
    target = dqreg.prepare_target(bracket_mesh()) if is_prepared else bracket_mesh()
    problem = problem_of(bracket_points(40, seed=0), target)
    search = GlobalSearch.of(problem, problem.prepare())
    with until(0.0), pytest.raises(TimeUpError):
        search._pairs()
    # Under way, or left.
    assert (problem.target.derived.known(PAIRS) is not None) == is_prepared
    assert search._pairs() is problem.target.pairs
