"""simpleICP: point to plane on a thousand points, with rejection by planarity and by the median of the residuals.

Manual: the README of pglira/simpleICP and the docstring of ``SimpleICP.run``.
"""

from __future__ import annotations

import dataclasses
import importlib.metadata
from types import ModuleType
from typing import Any

import numpy as np

from dqreg.compare.engines.clouds import MAX_DISTANCE, source_cloud, target_cloud, task_size
from dqreg.compare.engines.harness import RunClock, initial_pose, silent, timed
from dqreg.compare.engines.protocol import EngineOutput, Setting, Task
from dqreg.errors import MissingDependencyError, load_package

# Points drawn from a mesh: as many as in its manual's examples. It copies the whole cloud once for each of its
# thousand normals, so that more of them cost it seconds.
MESH_SAMPLES = 100_000


@dataclasses.dataclass(frozen=True)
class SimpleIcp:
    """simpleICP; the target is its fixed cloud, the source the movable one."""

    name: str = "simpleicp"
    needs: tuple[str, ...] = ("simpleicp",)
    needs_initial_pose: bool = True
    # Its correspondences go from a sample of the target to the source and have no maximum distance: not the same loop.
    settings: tuple[Setting, ...] = ("manual",)

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        require_old_pandas()
        simple = load_package("simpleicp", "simpleicp")
        inner = load_package("simpleicp.simpleicp", "simpleicp")
        return timed(
            self,
            task,
            lambda clock, settings: self._work(simple, task, clock, settings),
            (inner.SimpleICPException,),
        )

    def _work(self, simple: ModuleType, task: Task, clock: RunClock, settings: dict[str, Any]) -> EngineOutput:
        axes = ["x", "y", "z"]
        settings["threads_of_search"] = "all: simpleICP asks SciPy's tree with workers=-1"
        with silent():
            with clock.preparing():
                target = target_cloud(task, settings, MESH_SAMPLES).points
                fixed = simple.PointCloud(np.array(target), columns=axes)
            moving = simple.PointCloud(np.array(source_cloud(task).points), columns=axes)
            icp = simple.SimpleICP()
            icp.add_point_clouds(fixed, moving)
            used = limits(task)
            settings.update(used)
            T, _, _, residuals = icp.run(**used)
        return EngineOutput(
            np.array(T), f"point-to-plane residuals: mean {residuals.mean():.4g}, std {residuals.std():.4g}"
        )


def limits(task: Task) -> dict[str, Any]:
    """Every argument of ``SimpleICP.run``."""
    return {
        # Defaults of the manual.
        "correspondences": 1000,
        "neighbors": 10,
        "min_planarity": 0.3,
        "min_change": 1.0,
        "max_iterations": 100,
        "distance_weights": 1,
        # "Maximum overlap distance": left to the user.
        "max_overlap_distance": MAX_DISTANCE * task_size(task),
        "rbp_observed_values": euler_angles(task),
        "rbp_observation_weights": (0.0,) * 6,
    }


def euler_angles(task: Task) -> tuple[float, ...]:
    """The initial pose as simpleICP's rigid-body parameters.

    >>> from dqreg.geometry import PointCloud
    >>> cloud = PointCloud([[0, 0, 0]])
    >>> turned = np.array([[0.0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]])
    >>> euler_angles(Task(cloud, cloud, turned))
    (0.0, 0.0, 90.0, 5.0, 6.0, 7.0)
    """
    T = initial_pose(task)
    R = T[:3, :3]
    angles = (np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(np.clip(R[0, 2], -1.0, 1.0)), np.arctan2(-R[0, 1], R[0, 0]))
    # Adding zero turns -0.0 into 0.0.
    return tuple(float(value) + 0.0 for value in (*np.rad2deg(angles), *T[:3, 3]))


def require_old_pandas() -> None:
    """Raise where simpleICP meets a pandas that it cannot work with."""
    try:
        simple, pandas = (importlib.metadata.version(name) for name in ("simpleicp", "pandas"))
    except importlib.metadata.PackageNotFoundError:
        return
    if simple == "2.0.15" and int(pandas.partition(".")[0]) >= 3:
        raise MissingDependencyError(
            f"simpleicp {simple} cannot work with pandas {pandas}; run: pip install 'pandas<3'"
        )
