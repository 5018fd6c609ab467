from __future__ import annotations

import inspect
import numbers
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from dqreg.compare.engines import ENGINES, Task, missing, open3d_global, open3d_icp, open3d_tensor
from dqreg.compare.engines import kiss_icp as kiss_icp_map
from dqreg.compare.engines import kiss_matcher as kiss_matcher_
from dqreg.compare.engines import simpleicp as simpleicp_
from dqreg.compare.engines import small_gicp as small_gicp_icp
from dqreg.compare.engines import trimesh as trimesh_icp
from dqreg.compare.engines.clouds import task_size
from dqreg.geometry import PointCloud
from tests.compare.engines.cases import task

SPIED = {
    "open3d point-to-plane": open3d_icp,
    "open3d point-to-plane staged": open3d_icp,
    "open3d point-to-plane robust": open3d_icp,
    "open3d ndt": open3d_icp,
    "open3d fpfh+fgr": open3d_global,
    "small_gicp vgicp": small_gicp_icp,
    "small_gicp plane staged": small_gicp_icp,
    "small_gicp gicp fine": small_gicp_icp,
    "kiss-icp map": kiss_icp_map,
    "trimesh icp as shipped": trimesh_icp,
    "kiss-matcher": kiss_matcher_,
}


class Spy:
    """A module that writes down every number its functions are called with."""

    def __init__(self, module: ModuleType, heard: list[float]) -> None:
        self._module, self._heard = module, heard

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._module, name)
        if inspect.ismodule(value):
            return Spy(value, self._heard)
        if not callable(value):
            return value

        def listened(*args: Any, **kwargs: Any) -> Any:
            self._heard.extend(numbers_in([*args, *kwargs.values()]))
            return value(*args, **kwargs)

        return listened


def numbers_in(value: Any) -> Iterator[float]:
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for item in value:
            yield from numbers_in(item)
    elif isinstance(value, numbers.Real) and not isinstance(value, bool):
        yield float(value)


# Pure numbers: counts, angles and shares of the number of points. All else is a length, and scales as one.
NO_LENGTHS = {
    *("num_neighbors", "num_threads", "max_iterations", "rotation_epsilon", "max_num_iterations", "max_num_threads"),
    *("max_points_per_voxel", "relative_fitness", "max_iteration", "registration_type", "correspondences"),
    *("neighbors", "min_planarity", "min_change", "distance_weights", "rbp_observed_values"),
    *("rbp_observation_weights",),
}


@pytest.mark.parametrize(
    "limits",
    [
        kiss_icp_map.limits,
        lambda given: small_gicp_icp.limits(given, "VGICP"),
        open3d_tensor.scales,
        simpleicp_.limits,
        lambda given: open3d_icp.criteria(given, task_size(given), 30),
        lambda given: {"max_distance": open3d_icp.max_distance(given, task_size(given))},
    ],
    ids=["kiss-icp", "small_gicp", "tensor", "simpleicp", "open3d criteria", "open3d distance"],
)
@pytest.mark.parametrize("setting", ["manual", "same-loop"])
def test_every_length_of_a_peer_scales_with_the_unit(limits: Callable[[Task], dict[str, Any]], setting: str) -> None:
    given = task("", setting)
    large = task(
        "",
        setting,
        source=PointCloud(given.source.points * 1000.0),
        target=PointCloud(given.target.points * 1000.0),
        max_distance=None if given.max_distance is None else given.max_distance * 1000.0,
    )
    one, other = limits(given), limits(large)
    assert one.keys() == other.keys()
    for key, value in one.items():
        # A voxel size of -1 is Open3D's word for none.
        factor = 1.0 if key in NO_LENGTHS or value == [-1.0] else 1000.0
        np.testing.assert_allclose(
            [number * factor for number in numbers_in(value)], list(numbers_in(other[key])), rtol=1e-12
        )


@pytest.mark.parametrize("name", list(SPIED))
def test_settings_hold_every_number_of_the_call(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lacking = missing(ENGINES[name])
    if lacking:
        pytest.skip(f"not installed: pip install {' '.join(lacking)}")
    heard: list[float] = []
    for door in ("load_open3d", "load_package"):
        if hasattr(SPIED[name], door):
            opened = getattr(SPIED[name], door)
            monkeypatch.setattr(SPIED[name], door, lambda *args, opened=opened: Spy(opened(*args), heard))
    done = ENGINES[name].register(task(name))
    written = set(numbers_in(done.settings))
    assert len(heard) >= 2
    assert set(heard) <= written
