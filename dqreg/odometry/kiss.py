"""The one door to KISS-ICP: its parts, with what makes its C++ core end the whole process kept away from it.

A pose that is not orthogonal to ten digits, or points that all carry one time, stop the interpreter there (checked
with kiss-icp 1.3): poses are made rigid and such times are dropped before anything is handed over.
"""

from __future__ import annotations

import platform
import sys
from typing import Any

from dqreg._arrays import FloatArray
from dqreg.errors import load_package
from dqreg.odometry.settings import Resolved
from dqreg.rigid.single_pose import orthonormal


def load_kiss(module: str) -> Any:
    """A module of KISS-ICP."""
    return load_package(f"kiss_icp.{module}", '"kiss-icp>=1.2"', f"odometry{_without_wheel()}")


def _without_wheel() -> str:
    """What a machine lacks for which KISS-ICP 1.3 has no wheel, in brackets; as in pyproject.toml."""
    has_wheel = sys.version_info < (3, 14) and (sys.platform != "darwin" or platform.machine() == "arm64")
    here = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    wheels = "Python 3.11 to 3.13 on Linux, Windows and Apple silicon have one"
    return "" if has_wheel else f" (there is no wheel of KISS-ICP for {here}; {wheels}, else a C++ compiler is needed)"


class KissParts:
    """KISS-ICP's adaptive threshold, set up for one sequence."""

    def __init__(self, settings: Resolved) -> None:
        s = settings
        config = load_kiss("config").KISSConfig()
        config.data.max_range, config.data.min_range, config.data.deskew = s.max_range, s.min_range, s.deskew
        config.mapping.voxel_size = s.voxel_size
        # One voxel is what the loop can always bridge, so a motion of a tenth of it is none.
        config.adaptive_threshold.initial_threshold = s.reach
        config.adaptive_threshold.min_motion_th = 0.1 * s.voxel_size
        config.registration.max_num_threads = s.threads
        self._threshold = load_kiss("threshold").get_threshold_estimator(config)

    @property
    def deviation(self) -> float:
        """How far constant velocity has been off lately, one sigma, as a length at the largest range."""
        return float(self._threshold.get_threshold())

    def learn(self, deviation: FloatArray) -> None:
        """Tell the threshold how far the prediction was off, (4, 4)."""
        self._threshold.update_model_deviation(orthonormal(deviation))
