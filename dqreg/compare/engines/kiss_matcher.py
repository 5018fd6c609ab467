"""KISS-Matcher: global registration by features, graph pruning and a robust solver; alone, and refined.

Manual: the README and ``examples/run_kiss_matcher.py`` of MIT-SPARK/KISS-Matcher: one number, the voxel size, 0.3 by
default; everything else is a multiple of it. Its lengths are metres: voxels below 0.005 are refused and noise bounds
above 1.0 are cut off. Where it serves loop closing, its authors refine its pose with small_gicp.
"""

from __future__ import annotations

import dataclasses
from types import ModuleType
from typing import Any

import numpy as np

from dqreg.compare.engines.clouds import source_cloud, target_cloud, task_size
from dqreg.compare.engines.harness import RunClock, no_pose, silent, timed
from dqreg.compare.engines.protocol import EngineOutput, Setting, Task
from dqreg.compare.engines.small_gicp import limits, preprocess
from dqreg.errors import load_package

# As a fraction of the size. On a bracket, 1/100 found the basin of 4 of 4 poses; 1/150 (closer, where it succeeded),
# 1/70, 1/50 and 1/30 found fewer.
VOXEL_SHARE = 1.0 / 100.0
# The default, with the defaults that follow from it.
DEFAULTS: dict[str, Any] = {
    "voxel_size": 0.3,
    "use_voxel_sampling": True,
    "use_quatro": False,
    "thr_linearity": 1.0,
    "num_max_corr": 5000,
    "normal_r_gain": 3.0,
    "fpfh_r_gain": 5.0,
    "robin_noise_bound_gain": 1.0,
    "solver_noise_bound_gain": 0.75,
    "enable_noise_bound_clamping": True,
}


@dataclasses.dataclass(frozen=True)
class KissMatcher:
    """KISS-Matcher; the initial pose is not used."""

    name: str  # Shown in tables
    refined: bool = False  # Whether small_gicp's GICP follows
    needs: tuple[str, ...] = ("kiss-matcher",)
    needs_initial_pose: bool = False
    settings: tuple[Setting, ...] = ("manual",)

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        matcher = load_package("kiss_matcher", "kiss-matcher")
        gicp = load_package("small_gicp", "small-gicp") if self.refined else None
        return timed(
            self, task, lambda clock, settings: self._work(matcher, gicp, task, clock, settings), (RuntimeError,)
        )

    def _work(
        self, kiss: ModuleType, gicp: ModuleType | None, task: Task, clock: RunClock, settings: dict[str, Any]
    ) -> EngineOutput:
        # A unit of length in which the voxel is the default one: what it cuts off in metres then means the same for
        # every part. The pose comes back in the task's own unit.
        unit = VOXEL_SHARE * task_size(task) / DEFAULTS["voxel_size"]
        settings.update(DEFAULTS, start="not used", unit=unit, voxel_size_in_task_unit=VOXEL_SHARE * task_size(task))
        settings["threads_of_matcher"] = "its own choice: the Python interface takes no number"
        with silent():
            with clock.preparing():
                target = target_cloud(task, settings).points
            source = source_cloud(task).points
            matcher = kiss.KISSMatcher(kiss.KISSMatcherConfig(**DEFAULTS))
            solution = matcher.estimate((source / unit).astype(np.float32), (target / unit).astype(np.float32))
            if not solution.valid:
                return no_pose("not valid")
            T = np.eye(4)
            T[:3, :3] = solution.rotation
            T[:3, 3] = np.array(solution.translation) * unit
            self_report = f"valid, {matcher.get_num_final_inliers()} final inliers"
            if gicp is None:
                return EngineOutput(T, self_report)
            used = settings["refinement"] = limits(task, "GICP")
            target_down, tree = preprocess(gicp, target, used)
            fine = gicp.align(
                target_down,
                preprocess(gicp, source, used)[0],
                tree,
                T,
                **{name: used[name] for name in REFINEMENT},
            )
        ended = "converged" if fine.converged else "not converged"
        self_report += f"; refinement {ended}, {fine.num_inliers} correspondences"
        return EngineOutput(np.array(fine.T_target_source), self_report, int(fine.iterations))


REFINEMENT = (
    "registration_type",
    "max_correspondence_distance",
    "num_threads",
    "max_iterations",
    "rotation_epsilon",
    "translation_epsilon",
)
