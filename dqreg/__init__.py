"""Registers scans to CAD meshes and clouds.

The dual-quaternion closed form of Walker, Shao and Volz (1991), for matched points and directions, inside an ICP loop
whose correspondences are exact: closest points on triangles for meshes, nearest neighbours for clouds.

>>> import dqreg
>>> fit = dqreg.solve([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [2, 0, 0], [1, 1, 0]])
>>> fit.T_target_source[:3, 3].round(12).tolist()
[1.0, 0.0, 0.0]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dqreg import solvers
from dqreg.errors import DegenerateGeometryError, DqregError, InputError, MissingDependencyError, UnitsError
from dqreg.geometry import Mesh, PointCloud
from dqreg.register import Target, prepare_target, register
from dqreg.result import Registration
from dqreg.rigid import DualQuaternion, quaternion
from dqreg.solvers import Freedom, PoseCost, likelihood_weights, solve, solve_many

if TYPE_CHECKING:
    from dqreg.odometry import Odometry

__all__ = [
    "DegenerateGeometryError",
    "DqregError",
    "DualQuaternion",
    "Freedom",
    "InputError",
    "Mesh",
    "MissingDependencyError",
    "Odometry",
    "PointCloud",
    "PoseCost",
    "Registration",
    "Target",
    "UnitsError",
    "likelihood_weights",
    "prepare_target",
    "quaternion",
    "register",
    "solve",
    "solve_many",
    "solvers",
]

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    # The odometry stands on KISS-ICP, which takes its time to load and need not be installed.
    if name == "Odometry":
        from dqreg.odometry import Odometry

        return Odometry
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
